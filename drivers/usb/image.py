"""From the bytes of a frame to distance and amplitude, and what no camera can have sent."""

import numpy as np
from numpy.typing import NDArray

from drivers.errors import OperationError
from drivers.usb.profile import Image

JUMP = 1 << 14
"""Counts, a quarter of the full scale: neighbouring amplitudes of a scene hardly ever differ by so much."""

MAX_JUMPS = 0.25
"""Share of such neighbours above which an image is noise. Uniform noise has (3/4)² = 0.56, a frame of which
half is noise 0.28; in eight public frames of a real SR4000 there are none at all."""


def split(data: "NDArray[np.uint8]", image: Image) -> NDArray[np.uint16]:
    """The images of a frame, (planes, rows, columns), copied out of the buffer.

    Raises:
        OperationError: too few bytes.
    """
    if data.size < image.frame_bytes:
        raise OperationError(f"short frame: {data.size} of {image.frame_bytes} bytes")
    order = "<u2" if image.byte_order.known == "little" else ">u2"
    shape = (len(image.planes.known), image.rows.known, image.columns.known)
    return data[: image.frame_bytes].view(order).reshape(shape).astype(np.uint16)


def unpack(images: NDArray[np.uint16], image: Image) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Distance and amplitude, (rows, columns) uint16 each.

    Bits of the distance that the model is known not to use are cleared.

    Raises:
        OperationError: an amplitude image that is constant or pure noise.
    """
    planes = image.planes.known
    counts, amplitude = (images[planes.index(name)] for name in ("distance", "amplitude"))
    _check(counts, amplitude)
    if image.significant_bits.value is not None:
        counts = counts & np.uint16(0xFFFF << (16 - image.significant_bits.value) & 0xFFFF)
    return counts, amplitude


def _check(counts: NDArray[np.uint16], amplitude: NDArray[np.uint16]) -> None:
    if counts.min() == counts.max() and amplitude.min() == amplitude.max():
        raise OperationError(f"implausible frame: every amplitude is {amplitude.flat[0]}")
    smaller = np.minimum(amplitude[:, 1:], amplitude[:, :-1])
    larger = np.maximum(amplitude[:, 1:], amplitude[:, :-1])
    share = np.count_nonzero(larger - smaller >= JUMP) / smaller.size
    if share > MAX_JUMPS:
        raise OperationError(
            f"implausible frame: {share:.0%} of neighbouring amplitudes differ by {JUMP} counts or more"
        )
