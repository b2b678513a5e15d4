"""A few threads that walk one loop together and meet at barriers.

A parallel region of Numba's wakes its threads and lets them sleep again: measured 0.1–0.3 ms each time, as
long as a whole pass over an image takes, several times an iteration. Here the threads stay awake for as long
as the loop runs, and a meeting takes a tenth of a microsecond. Who waits long lets others run.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import numba
import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

_PATIENCE = 2000
"""Looks at the barrier, some microseconds, before a waiting thread lets others run at every look."""

_COME, _BROKEN, _TURN = 0, 1, 8
"""Where a barrier counts those who have come, where it says that one never will, and, a cache line away,
where it counts its meetings."""

_sched_yield = types.ExternalFunction("sched_yield", types.int32())


def _pointer(context, builder, kind, array, index):  # type: ignore[no-untyped-def]
    view = context.make_array(kind)(context, builder, array)
    return cgutils.get_item_pointer(  # type: ignore[no-untyped-call]
        context, builder, kind, view, [index], wraparound=False
    )


@intrinsic
def _add(_, array, index, value):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """array[index] += value as one step that no other thread can divide; the value before."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        kind, array, at = signature.args[0], arguments[0], arguments[1]
        place = _pointer(context, builder, kind, array, at)  # type: ignore[no-untyped-call]
        return builder.atomic_rmw("add", place, arguments[2], "seq_cst")

    return types.int64(array, types.intp, types.int64), generate


@intrinsic
def _read(_, array, index):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """array[index] as the other threads have left it."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        kind, array, at = signature.args[0], arguments[0], arguments[1]
        place = _pointer(context, builder, kind, array, at)  # type: ignore[no-untyped-call]
        return builder.load_atomic(place, "seq_cst", 8)

    return types.int64(array, types.intp), generate


@njit(nogil=True)
def meet(barrier, size):  # type: ignore[no-untyped-def]
    """Return once all `size` threads have come; what each wrote before, all can read after.

    Where one has failed the others go on alone: what they write is worth nothing, and `run` raises.
    """
    if size == 1:
        return
    turn = _read(barrier, _TURN)  # type: ignore[call-arg, var-annotated]
    if _add(barrier, _COME, 1) == size - 1:
        _add(barrier, _COME, -size)
        _add(barrier, _TURN, 1)
        return
    looks = 0
    while _read(barrier, _TURN) == turn:
        looks += 1
        if looks > _PATIENCE:
            if _read(barrier, _BROKEN):
                return
            _sched_yield()


_one_team = threading.Lock()
_pool: ThreadPoolExecutor | None = None


def run(loop: Callable[..., None], *arguments: Any) -> None:
    """`share` of loop(rank, size, barrier, *arguments), whose threads `meet` at the barrier.

    Where one fails, as for want of memory, the others leave the barrier, and what it raised is raised here.
    """
    barrier = np.zeros(_TURN + 8, np.int64)
    failures: list[BaseException] = []

    def member(rank: int, size: int) -> None:
        try:
            loop(rank, size, barrier, *arguments)
        except BaseException as failure:
            failures.append(failure)
            barrier[_BROKEN] = 1

    try:
        share(member)
    finally:
        barrier[_BROKEN] = 1  # for those who would wait for one that could not be started
    if failures:
        raise failures[0]


def share(loop: Callable[..., None], *arguments: Any) -> None:
    """Call the compiled (`nogil`) loop(rank, size, *arguments) in `size` threads and wait for all.

    There are as many threads as Numba may use, but one while another team is at work: loops must give the
    same bits for any size. Such a loop compiles in half the time of one that Numba makes parallel.
    """
    size = numba.get_num_threads()
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
