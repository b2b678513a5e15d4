"""Compressed images: PNG and its like, and what ROS's `compressed_depth_image_transport` makes of depth."""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.depth.rvl import rvl_decoded
from drivers.errors import RecordingError

_HEADER = struct.Struct("<iff")
"""Of compressedDepth: how it is quantised, and two parameters of inverse depth."""

_LOSSY = ("jpeg", "jpg", "webp", "avif")
_LOSSLESS = ("png", "tiff", "tif")


def is_depth_format(told: str) -> bool:
    """Whether a `format` field is one of `compressedDepth`."""
    return "compresseddepth" in told.lower()


def decompressed(told: str, data: bytes | NDArray[np.uint8]) -> NDArray[Any]:
    """(H, W) pixels of a compressed image: uint16 or uint8 as they were, float32 metres of a 32FC1 depth.

    Args:
        told: `format` of the message: `png`, `16UC1; png compressed `, `32FC1; compressedDepth png`, ….
        data: the compressed image.

    Raises:
        RecordingError: a compression not known here, or data that are not of it.
    """
    content = np.frombuffer(data, np.uint8)
    if is_depth_format(told):
        return _depth(told, content)
    if any(name in told.lower() for name in (*_LOSSLESS, *_LOSSY)):
        return picture(content, told)
    known = ", ".join([*_LOSSLESS, *_LOSSY, "compressedDepth png", "compressedDepth rvl"])
    raise RecordingError(f"compression {told!r} cannot be read here; known are {known}: record it otherwise")


def is_lossy(told: str) -> bool:
    """Whether a `format` field names a compression that changes values, so that no depth survives it."""
    return not is_depth_format(told) and any(name in told.lower() for name in _LOSSY)


def picture(content: NDArray[np.uint8], origin: str) -> NDArray[Any]:
    """(H, W) pixels of a picture file of one channel; raises `RecordingError` where it is none."""
    import cv2

    try:
        image = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    except cv2.error:
        image = None
    if image is None:
        raise RecordingError(f"{origin}: its {content.size:,} bytes are no picture that can be decoded")
    if image.ndim != 2:
        raise RecordingError(
            f"{origin}: a picture of {image.shape[2]} channels; expected one channel of depth or amplitude"
        )
    return np.asarray(image)


def _depth(told: str, content: NDArray[np.uint8]) -> NDArray[Any]:
    """After compressed_depth_image_transport (codec.cpp, rvl_codec.cpp): a header, then PNG or RVL.

    Depth in metres (32FC1) is stored as v = A / Z + B, rounded; 0 = none.
    """
    if content.size <= _HEADER.size:
        raise RecordingError(
            f"{told}: {content.size} bytes; expected a header of {_HEADER.size} and an image"
        )
    _, scale, offset = _HEADER.unpack(content[: _HEADER.size].tobytes())
    body = content[_HEADER.size :]
    packed = rvl_decoded(body) if "rvl" in told.lower() else picture(body, told)
    if packed.dtype != np.uint16:
        raise RecordingError(f"{told}: holds {packed.dtype}; expected 16 bits")
    if not told.upper().lstrip().startswith("32FC1"):
        return packed
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.float32(scale) / (packed.astype(np.float32) - np.float32(offset))
    return np.where(packed == 0, np.float32(np.nan), depth)
