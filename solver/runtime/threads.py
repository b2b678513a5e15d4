"""How many threads a fusion is worth: waking a second one takes longer than a small image's kernels."""

from collections.abc import Iterator
from contextlib import contextmanager

import numba

ALONE = 40_000
"""Fused pixels up to which one thread is faster: a kernel then takes less than waking
a sleeping thread does (threads sleep when idle, see `solver.kernels`)."""


@contextmanager
def enough_threads(pixels: int) -> Iterator[None]:
    """Run kernels on one thread for this few fused pixels, on all there are otherwise."""
    before = numba.get_num_threads()
    if pixels <= ALONE:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
