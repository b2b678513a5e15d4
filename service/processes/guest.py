"""Work in a process of somebody else's, such as a worker of a Dask cluster, as fast as in one of ours."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from service.processes.threads import solver_threads

T = TypeVar("T")

_KEPT = 64 << 20
"""Bytes to which glibc raises it by itself, where nobody has set it, when large arrays come and go."""


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
    from solver.runtime.memory import keep_at_most  # only here: Numba takes long to import

    if "MALLOC_TRIM_THRESHOLD_" in os.environ:
        keep_at_most(_KEPT)
