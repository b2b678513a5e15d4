"""Where the threads of a team meet, and what they take their work from; see `solver.runtime.team`."""

from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

_PATIENCE = 2000
"""Looks at the barrier, some microseconds, before a waiting thread lets others run at every look."""

_COME, BROKEN, MEETINGS = 0, 1, 8
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
    meeting = _read(barrier, MEETINGS)  # type: ignore[call-arg, var-annotated]
    if _add(barrier, _COME, 1) == size - 1:
        _add(barrier, _COME, -size)
        _add(barrier, MEETINGS, 1)
        return
    looks = 0
    while _read(barrier, MEETINGS) == meeting:
        looks += 1
        if looks > _PATIENCE:
            if _read(barrier, BROKEN):
                return
            _sched_yield()


@njit(nogil=True)
def take(counter):  # type: ignore[no-untyped-def]
    """The number of the next piece of work that no thread has taken, by a counter (1,)."""
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        counter[0] += 1
        return counter[0] - 1
    return _add(counter, 0, 1)  # type: ignore[call-arg]
