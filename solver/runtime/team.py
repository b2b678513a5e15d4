"""A few threads that walk one loop together and meet at barriers.

A parallel region of Numba's wakes its threads and lets them sleep again, which takes as long as a whole
pass over an image, several times an iteration. Here the threads stay awake for as long as the loop runs,
and a meeting costs next to nothing. Who waits long lets others run.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import numba
import numpy as np

from solver.kernels.barrier import BROKEN, MEETINGS

_WORTH = 50_000
"""Samples that take some hundred microseconds, several times what it takes to wake a thread."""

_one_team = threading.Lock()
_pool: ThreadPoolExecutor | None = None


def run(loop: Callable[..., None], *arguments: Any) -> None:
    """`share` of loop(rank, size, barrier, *arguments), whose threads `meet` at the barrier.

    Where one fails, as for want of memory, the others leave the barrier, and what it raised is raised here.
    """
    barrier = np.zeros(MEETINGS + 8, np.int64)
    failures: list[BaseException] = []

    def member(rank: int, size: int) -> None:
        try:
            loop(rank, size, barrier, *arguments)
        except BaseException as failure:
            failures.append(failure)
            barrier[BROKEN] = 1

    try:
        share(member)
    finally:
        barrier[BROKEN] = 1  # for those who would wait for one that could not be started
    if failures:
        raise failures[0]


def hand_out(count: int, loop: Callable[..., None], *arguments: Any) -> None:
    """Call the compiled (`nogil`) loop(counter, *arguments), whose threads `take` pieces until none is left.

    A thread that has not woken by then is not waited for: where others are at work it gets a processor after
    milliseconds. Of a few samples, `count`, nothing is handed out.
    """
    counter = np.zeros(1, np.int64)
    size = 1 if numba.config.DISABLE_JIT else numba.get_num_threads()  # type: ignore[attr-defined]
    if size == 1 or count < _WORTH or not _one_team.acquire(blocking=False):
        loop(counter, *arguments)
        return
    try:
        others = [_others().submit(loop, counter, *arguments) for _ in range(1, size)]
        try:
            loop(counter, *arguments)
        finally:
            late = [other for other in others if not other.cancel()]
            wait(late)
        for other in late:
            other.result()
    finally:
        _one_team.release()


def share(loop: Callable[..., None], *arguments: Any) -> None:
    """Call the compiled (`nogil`) loop(rank, size, *arguments) in `size` threads and wait for all.

    There are as many threads as Numba may use, but one while another team is at work: loops must give the
    same bits for any size. Such a loop compiles in half the time of one that Numba makes parallel.
    """
    # What is not compiled holds Python's lock, and has no barrier.
    size = 1 if numba.config.DISABLE_JIT else numba.get_num_threads()  # type: ignore[attr-defined]
    if size == 1 or not _one_team.acquire(blocking=False):
        loop(0, 1, *arguments)
        return
    try:
        others = [_others().submit(loop, rank, size, *arguments) for rank in range(1, size)]
        try:
            loop(0, size, *arguments)
        finally:
            # Also after a failure nobody may still write to what the caller has back.
            wait(others)
        for other in others:
            other.result()
    finally:
        _one_team.release()


def share_frames(count: int, loop: Callable[..., None], *arguments: Any) -> None:
    """`share` a loop over so many frames; one of them is done before another thread is awake."""
    if count == 1:
        loop(0, 1, *arguments)
    else:
        share(loop, *arguments)


def _others() -> ThreadPoolExecutor:
    global _pool
    if _pool is None:
        _pool = ThreadPoolExecutor(
            numba.config.NUMBA_NUM_THREADS,  # type: ignore[attr-defined]
            thread_name_prefix="solver",
        )
    return _pool


def _forget() -> None:
    """A forked process has none of its parent's threads."""
    global _pool, _one_team
    _pool, _one_team = None, threading.Lock()


os.register_at_fork(after_in_child=_forget)
