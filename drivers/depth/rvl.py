"""RVL, a lossless code for depth images: runs of zeros, runs of differences, in groups of four bits.

Source: A. D. Wilson, "Fast Lossless Depth Image Compression", ISS 2017; the two sizes in front are those of
ROS's compressed_depth_image_transport.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError

_MOST_PIXELS = 1 << 26


def rvl_decoded(content: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """(H, W) uint16 of columns, rows (int32 each) and an RVL stream; raises `RecordingError` for garbage."""
    if content.size < 8:
        raise RecordingError("RVL: shorter than its sizes")
    columns, rows = struct.unpack("<ii", content[:8].tobytes())
    if not (columns > 0 and rows > 0 and columns * rows <= _MOST_PIXELS):
        raise RecordingError(f"RVL: an image of {rows} × {columns} pixels cannot be")
    numbers = _numbers(content[8:])
    image = np.zeros(columns * rows, dtype=np.uint16)
    filled, at, last = 0, 0, 0
    while filled < image.size:
        if at + 2 > numbers.size:
            raise RecordingError(f"RVL: torn, {filled:,} of {image.size:,} pixels are there")
        zeros, length = int(numbers[at]), int(numbers[at + 1])
        codes = numbers[at + 2 : at + 2 + length]
        filled += zeros
        if codes.size < length or filled + length > image.size or zeros + length == 0:
            raise RecordingError("RVL: runs that do not fit the image")
        if length:
            values = last + np.cumsum((codes >> 1) ^ -(codes & 1))
            image[filled : filled + length] = values.astype(np.uint16)
            last = int(values[-1])
        filled, at = filled + length, at + 2 + length
    return image.reshape(rows, columns)


def _numbers(content: NDArray[np.uint8]) -> NDArray[np.int64]:
    """All numbers of the stream: three bits a group, the lowest first, the fourth says that more follow."""
    words = content[: content.size // 4 * 4].view("<u4")
    groups = ((words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32)) & 0xF).ravel().astype(np.int64)
    ends = np.flatnonzero(groups < 8)
    if not ends.size:
        return np.zeros(0, dtype=np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    place = np.arange(ends[-1] + 1) - np.repeat(starts, ends - starts + 1)
    if place.max() > 6:  # 21 bits; a difference has 17 and a run no more than the image
        raise RecordingError("RVL: a number that is too large")
    return np.add.reduceat((groups[: ends[-1] + 1] & 7) << (3 * place), starts)
