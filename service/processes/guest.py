"""Work in a process of somebody else's, such as a worker of a Dask cluster, as fast as in one of ours."""

import ctypes
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TypeVar

from service.processes.threads import solver_threads

T = TypeVar("T")

_TRIM, _MAP = -1, -3
"""M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's `mallopt`."""

_KEPT, _MAPPED = 64 << 20, 32 << 20
"""Bytes to which glibc raises them by itself, where nobody has set one, when large arrays come and go."""


def as_guest(work: Callable[[], T]) -> T:
    """What some work gives, with one thread of the solver and of OpenCV.

    It is done in a thread of its own: a worker samples the stacks of those that it gives tasks to, a hundred
    times a second, and finds one that waits.
    """
    import cv2

    cv2.setNumThreads(1)
    _keep_freed_memory()
    with ThreadPoolExecutor(1, "guest") as executor:
        return executor.submit(_alone, work).result()


def _alone(work: Callable[[], T]) -> T:
    with solver_threads(1):
        return work()


def _keep_freed_memory() -> None:
    """Keep some megabytes for the next array, where the process was told to give back every page at once.

    Dask's nannies tell their workers so: the pages of each array would be faulted in anew, which costs a
    solver a third of its time.
    """
    if "MALLOC_TRIM_THRESHOLD_" in os.environ:
        with suppress(AttributeError, OSError):  # another allocator
            libc = ctypes.CDLL(None)
            libc.mallopt(_MAP, _MAPPED)
            libc.mallopt(_TRIM, _KEPT)
