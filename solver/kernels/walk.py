"""One walk over the map does a whole iteration, so that what it needs is fetched from memory once.

The walk goes in strips of rows. Each is moved by the step that the last walk has found; `REACH` rows behind
it the next direction is found; and as many rows behind that as the operators reach, how the objective bends
along both. Of a team, each thread walks its part of the rows. The rows that its neighbours read too it moves
before they all walk, and those where it reads its neighbours' directions it leaves until all have walked.

Arrays that go together come in tuples: the `map` is (x, slope, radius), `operators` are (weights, curvature,
footprint, ties), and `work` is (data, step, direction, curved, curved_step, stiffness), see `iteration`.
"""

from numba import njit

from solver.kernels.blur import apply, rings
from solver.kernels.direction import descend, scratch
from solver.kernels.step import add_move, bend
from solver.kernels.tying import pull
from solver.kernels.view import view

REACH = 2
"""Rows that the prior reaches."""

STRIP = 8
"""Rows done at a time: few enough to stay in cache, many enough that a call's many arguments do not count."""

DESCENT, BENDS = 6, 5
"""Sums by row of `descend`, and after them of `bend`."""


@njit
def part(rank, size, rows, reach):  # type: ignore[no-untyped-def]
    """(top, low, high, end): a thread's rows, and those from which `reach` rows on are its own too."""
    top, end = rank * rows // size, (rank + 1) * rows // size
    low = top if rank == 0 else min(top + reach, end)
    return top, low, end if rank == size - 1 else max(end - reach, low), end


@njit
def on_the_way(map, operators):  # type: ignore[no-untyped-def]
    """What `bends` keeps from one row to the next."""
    _, _, taps, size = operators[2]
    return rings(map[0].shape[0], map[0].shape[2] - 4, taps, size)


@njit
def refresh(top, end, map, operators, work, kept):  # type: ignore[no-untyped-def]
    """The data's gradient in rows top to end, unless its operator is diagonal."""
    x, data = map[0], work[0]
    _, _, (stencil, side, taps, size), (levels, unit, lift) = operators
    for c in range(x.shape[0]):
        apply(top, end, c, x, stencil, side, taps, size, x.dtype.type(2), kept, False, data)
        if levels.shape[1] > 0:
            pull(top, end, c, x, levels, unit, data)
            data[c, top + 2 : end + 2] += lift[c, top + 2 : end + 2]


@njit
def move(top, end, by, map, operators, work):  # type: ignore[no-untyped-def]
    """Move rows top to end of the map by the step (a, b) in the two directions, and the data's gradient."""
    data, step, direction, curved, curved_step, _ = work
    add_move(top, end, by, direction, step, map[0])
    if operators[2][0].shape[1] > 0:
        add_move(top, end, by, curved, curved_step, data)


@njit
def bends(top, end, resume, operators, work, slack, within, kept, sums):  # type: ignore[no-untyped-def]
    """The direction's products with the operators in rows top to end, in sums.

    Args:
        resume: whether `kept`, which is `on_the_way`, holds what a call that ended at `top` has left.
        slack: stiffness by row, in a ring of any size; within: `prior.inside`.
    """
    _, step, direction, curved, _, _ = work
    weights, curvature, (stencil, _, taps, size), (levels, unit, _) = operators
    channels, n, two = direction.shape[0], direction.shape[2] - 4, direction.dtype.type(2)
    diagonal, none = stencil.shape[1] == 0, direction[:0]
    if not diagonal:
        for c in range(channels):
            apply(top, end, c, direction, stencil, none, taps, size, two, kept, resume, curved)
            if levels.shape[1] > 0:
                pull(top, end, c, direction, levels, unit, curved)
    for row in range(top, end):
        stiff, out = view(slack, (row % slack.shape[0],), 0, n + 4), view(sums, (row,), DESCENT, BENDS)
        bend(row, direction, step, curvature, diagonal, curved, stiff, weights, within, out)


@njit
def walk(rows, ahead, by, epsilon, map, operators, work, kept, sums):  # type: ignore[no-untyped-def]
    """An iteration up to the products that its step depends on, in the thread's `part`, rows.

    Args:
        ahead: (first, end) of the rows still to be moved, by the step `by`.
        sums: (rows, 11), of `descend` and then of `bend`.
    """
    top, low, high, end = rows
    x, slope, radius = map
    data, step, direction, _, _, stiffness = work
    weights, curvature, (stencil, _, _, _), _ = operators
    diagonal, n = stencil.shape[1] == 0, x.shape[2] - 4
    reach = reach_of(operators)
    lines = scratch(n, reach + STRIP, x.dtype)
    depth = lines[0].shape[0]
    for first in range(top - REACH, end + reach, STRIP):
        until = first + STRIP
        move(max(first + REACH, ahead[0]), min(until + REACH, ahead[1]), by, map, operators, work)
        descend(
            max(first, 0), min(until, end), top, x, slope, radius, epsilon, weights, curvature, diagonal,
            data, step, lines, direction, sums
        )  # fmt: skip
        for row in range(max(first, top), min(until, end)):
            if not low <= row < high:
                stiffness[row] = lines[0][row % depth]
        start, stop = max(first - reach, low), min(until - reach, high)
        if start < stop:
            bends(start, stop, start > low, operators, work, lines[0], lines[2], kept, sums)


@njit
def reach_of(operators):  # type: ignore[no-untyped-def]
    """Rows that the operators reach: the footprint and the coupling of its nodes, or the prior."""
    return max(REACH, operators[2][3])
