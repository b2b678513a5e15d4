"""The images that the library holds: where they lie, and copies of them."""

import ctypes
from ctypes import POINTER, c_int32, c_uint16, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import OperationError
from drivers.mesasr.library import Library

DISTANCE, AMPLITUDE, CONFIDENCE = 0, 1, 8
"""Image types (vendor header)."""

INDICES = {DISTANCE: 0, AMPLITUDE: 1, CONFIDENCE: 2}
"""How `SR_GetImage` counts them; a confidence map is there only in that acquire mode."""

UINT16 = 3
"""Data type of every image in practice (vendor header)."""


class ImageEntry(ctypes.Structure):
    """One entry of the image list; its fields lie alike in both builds, its size does not."""

    _pack_ = 4
    _layout_ = "ms"
    _fields_ = (
        ("image_type", c_int32),
        ("data_type", c_int32),
        ("data", c_void_p),
        ("width", c_uint16),
        ("height", c_uint16),
    )


STRIDES = (20, 24) if ctypes.sizeof(c_void_p) == 8 else (16,)
"""Sizes of an entry: packed to 4 bytes in older headers, naturally aligned in 1.0.14. The smaller is tried
first, for it reads nothing beyond a list of either kind."""


def image_addresses(
    library: Library, handle: c_void_p, shape: tuple[int, int], kinds: tuple[int, ...]
) -> dict[int, int]:
    """Addresses of images by type; valid until the mode is changed.

    Raises:
        OperationError: the library has no such image.
    """
    found = _from_list(library, handle, shape)
    if found is None:
        found = {kind: library.call("SR_GetImage", handle, INDICES[kind]) for kind in kinds}
    if not all(found.get(kind) for kind in kinds):
        raise OperationError(
            f"the library holds images of the types {sorted(kind for kind in found if found[kind])}, needed "
            f"are {list(kinds)} (0 distance, 1 amplitude, 8 confidence, which acquire_mode 0x100 asks for)"
            f"{library.explain()}"
        )
    return found


def copy_image(address: int, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """(rows, columns) uint16, copied out of the library's memory."""
    rows, columns = shape
    pixels = ctypes.cast(address, POINTER(c_uint16 * (rows * columns))).contents
    return np.array(pixels, dtype=np.uint16).reshape(shape)


def _from_list(library: Library, handle: c_void_p, shape: tuple[int, int]) -> dict[int, int] | None:
    if not library.has("SR_GetImageList"):
        return None
    start = c_void_p()
    count = library.call("SR_GetImageList", handle, ctypes.byref(start))
    if count < 2 or not start.value:
        return None
    stride = _stride(start.value, shape)
    if stride is None:
        return None
    entries = [_entry(start.value + index * stride) for index in range(count)]
    return {entry.image_type: entry.data for entry in entries if _fits(entry, shape)}


def _stride(start: int, shape: tuple[int, int]) -> int | None:
    return next((stride for stride in STRIDES if _fits(_entry(start + stride), shape)), None)


def _entry(address: int) -> Any:
    return ImageEntry.from_address(address)


def _fits(entry: Any, shape: tuple[int, int]) -> bool:
    return bool(entry.data) and entry.data_type == UINT16 and (entry.height, entry.width) == shape
