"""Pixels of an image message, whose rows may be padded and whose bytes may be swapped."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError

ENCODINGS: dict[str, str] = {
    "16UC1": "u2",
    "mono16": "u2",
    "16SC1": "i2",
    "32FC1": "f4",
    "64FC1": "f8",
    "8UC1": "u1",
    "mono8": "u1",
}
"""Encodings of one channel (sensor_msgs/image_encodings) and their types, without byte order."""

DEPTH_ENCODINGS = frozenset({"16UC1", "16SC1", "32FC1", "64FC1"})
"""Those that REP 118 and OpenCV's names use for depth; grey images have others."""


def unpacked(
    encoding: str, shape: tuple[int, int], step: int, is_bigendian: bool, data: bytes | NDArray[np.uint8]
) -> NDArray[Any]:
    """(H, W) pixels in the machine's byte order, read-only.

    Args:
        encoding: one of `ENCODINGS`.
        shape: rows and columns.
        step: bytes from row to row, padding included.
        is_bigendian: byte order of the data.
        data: of all rows; the last one's padding may be missing.

    Raises:
        RecordingError: an encoding not known here, no pixel, or data of another size.
    """
    kind = ENCODINGS.get(encoding)
    if kind is None:
        raise RecordingError(f"encoding {encoding!r} is none of {', '.join(ENCODINGS)}: name a depth image")
    rows, columns = shape
    dtype = np.dtype(kind).newbyteorder(">" if is_bigendian else "<")
    used = columns * dtype.itemsize
    if not (rows and columns):
        raise RecordingError(f"image of {rows} × {columns} pixels; expected at least one")
    content = np.frombuffer(data, np.uint8)
    if step < used or content.size < step * (rows - 1) + used:
        raise RecordingError(
            f"image of {rows} × {columns} pixels ({encoding}, {step} bytes a row) has {content.size:,} "
            f"bytes; expected {max(step, used) * rows:,}"
        )
    table = np.lib.stride_tricks.as_strided(content, (rows, used), (step, 1), writeable=False)
    pixels = np.ascontiguousarray(table).view(dtype)
    pixels = pixels.astype(dtype.newbyteorder("="), copy=False)
    pixels.flags.writeable = False
    return pixels
