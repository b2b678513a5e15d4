"""Freed memory is kept for the next image.

A fusion takes and frees some fifty images. The C library gives what is free at its end back to the system,
and every page of the next image is then fetched anew, which takes a good part of a full frame's time. Up to
`_KEPT` bytes stay with the process instead. Whoever sets glibc's own MALLOC_ variables decides otherwise.
"""

import ctypes
import os

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""glibc's numbers of the two parameters (mallopt(3))."""

_KEPT, _LARGEST = 256 << 20, 32 << 20
"""Bytes; the largest block that is kept is as large as glibc allows."""


def keep_freed() -> None:
    """Let the allocator keep what is freed, where it is glibc's and nobody has set it."""
    if not any(name in os.environ for name in ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_")):
        keep_at_most(_KEPT)


def keep_at_most(size: int) -> None:
    """Let the allocator keep so many bytes of what is freed, where it is glibc's, whoever has set it."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(_MMAP_THRESHOLD, _LARGEST)
        libc.mallopt(_TRIM_THRESHOLD, size)
