"""The loop of `solver.optimisation.memory_gradient`, walked by a team of threads.

Each thread has its rows; sums are kept by row and added in order by every thread for itself, so all take the
same decisions, and results are the same bits for any number of threads.
"""

import numpy as np
from numba import njit

from solver.kernels.barrier import meet
from solver.kernels.group import inside
from solver.kernels.walk import REACH, bends, move, on_the_way, part, reach_of, refresh, walk

EPSILON, FIT, DONE, SETTLED, BENT = range(5)
"""Places in the numbers that the loop takes and leaves."""


@njit
def _total(sums):  # type: ignore[no-untyped-def]
    total = np.zeros(sums.shape[1])
    for row in range(sums.shape[0]):
        for k in range(sums.shape[1]):
            total[k] += sums[row, k]
    return total


@njit(error_model="numpy")
def least(along, across, zz, zd, dd):  # type: ignore[no-untyped-def]
    """(a, b) of the least a · along + b · across + ½ (a, b) H (a, b)ᵀ, H = [[zz, zd], [zd, dd]]."""
    if zz <= 0:
        return 0.0, 0.0
    determinant = zz * dd - zd * zd
    # Parallel directions, and the first step, which has no other, leave one; float32 tells no more.
    if determinant <= 1e-5 * zz * dd:
        return -along / zz, 0.0
    return (zd * across - dd * along) / determinant, (zd * along - zz * across) / determinant


@njit
def error(history, count, least):  # type: ignore[no-untyped-def]
    """How far the last of `count` objectives is above the least, estimated; infinite while too early to tell.

    Two falls over a third of the iterations each (at least over the `least` number), the older d and the
    later e: if falls go on with the ratio e / d, what is left is e² / (d − e). Three times the estimate, and
    at least the last fall, is for falls that slow down.
    """
    window = max(least, count // 3)
    if count <= 2 * window:
        return np.inf
    last, before, first = history[count - 1], history[count - 1 - window], history[count - 1 - 2 * window]
    older, later = max(first - before, 0.0), max(before - last, 0.0)
    ratio = min(later / older, 0.95) if older > 0 else 0.0
    return later * max(1.0, 3 * ratio / (1 - ratio))


@njit(cache=True)
def decide(own, count, sums, fit, dd, epsilon, rule):  # type: ignore[no-untyped-def]
    """The end of an iteration: the step in the plane of the two directions, ε, and whether to stop.

    Args:
        own: (iterations,), objectives; the one of this is put in its place, count.
        count: iterations before this one.
        sums: (rows, 11), of `kernels.walk`.
        fit: value of the data term.
        dd: the last step's ⟨d, Hd⟩.
        epsilon: ε.
        rule: six numbers, as for `iterate`.

    Returns:
        the factors of direction and last step, and what becomes of fit, dd and epsilon; 1 = settled.
    """
    tolerance, hide, fall_of_epsilon, patience, _, window = rule
    roughness, hidden, along, across, data_along, data_across, lzz, lzd, ldd, zz, zd = _total(sums)
    a, b = least(along, across, lzz + zz, lzd + zd, ldd + dd)
    value = fit + roughness
    own[count] = value
    # The new step's product with the data's operator follows from those of the two it is made of.
    dd = a * a * zz + 2 * a * b * zd + b * b * dd
    fit += a * data_along + b * data_across + 0.5 * dd
    left = error(own, count + 1, window)
    settled = hidden <= hide * value and left <= tolerance * value
    if hidden > max(0.5 * hide * value, patience * left if left < np.inf else 0.0):
        epsilon *= fall_of_epsilon
    return a, b, fit, dd, epsilon, settled


@njit(nogil=True, cache=True)
def iterate(rank, size, barrier, map, operators, work, sums, rule, numbers, history):  # type: ignore[no-untyped-def]
    """Iterate until the objective has settled or `history` is full.

    Args:
        map: (x, slope, radius): the map (C, rows + 4, columns + 4), padded by 2 as all images are, in
            place; slope and radius see `direction.descend`.
        operators: (weights, curvature, footprint, ties): the first two see there; footprint is
            (stencil, side, taps, size) of `blur.apply`, no stencil = a diagonal operator, whose diagonal
            is the curvature; ties are (levels, unit, lift) of `kernels.tying`, no levels = none.
        work: (data, step, direction, curved, curved_step, stiffness): the data term's gradient (C, …),
            kept up to date, or the map that a diagonal operator draws to; the last step and the last
            direction (C, …); the operator's products with direction and step, unless it is diagonal; and
            (rows, columns + 4) for the stiffness of rows at the border of a thread's part.
        sums: (rows, 11), see `walk`.
        rule: (tolerance, part that the rounding may hide, fall of ε, patience, iterations to a refresh,
            least iterations of a fall).
        numbers: (5,) in and out: ε, value of the data term, iterations, 1 = settled, the step's ⟨d, Hd⟩.
        history: (iterations,), objectives, out.
    """
    again = rule[4]
    kind, rows = map[0].dtype.type, map[0].shape[1] - 4
    kept, dense = on_the_way(map, operators), operators[2][0].shape[1] > 0
    own, settled, moving, by = history.copy(), False, False, (kind(0), kind(0))
    epsilon, fit, count, dd = numbers[EPSILON], numbers[FIT], int(numbers[DONE]), numbers[BENT]
    within = inside(map[0].shape[2] - 4, kind)
    walked = part(rank, size, rows, reach_of(operators))
    top, low, high, end = part(rank, size, rows, REACH)
    while count < history.size and not settled:
        fresh = dense and count % again == 0
        ahead = (end, end)
        if moving:
            # What the neighbours read in the walk, or at once, is moved before it.
            ahead = (end, end) if fresh else (low, high)
            move(top, ahead[0], by, map, operators, work)
            move(ahead[1], end, by, map, operators, work)
            meet(barrier, size)
        if fresh:
            refresh(top, end, map, operators, work, kept)
        walk(walked, ahead, by, kind(epsilon), map, operators, work, kept, sums)
        meet(barrier, size)
        bends(top, walked[1], False, operators, work, work[5], within, kept, sums)
        bends(walked[2], end, False, operators, work, work[5], within, kept, sums)
        meet(barrier, size)
        by_a, by_b, fit, dd, epsilon, settled = decide(own, count, sums, fit, dd, epsilon, rule)
        by, moving = (kind(by_a), kind(by_b)), True
        count += 1
    if moving:
        move(top, end, by, map, operators, work)
    if rank == 0:
        history[:] = own
        numbers[EPSILON], numbers[FIT], numbers[DONE], numbers[SETTLED] = epsilon, fit, count, settled
        numbers[BENT] = dd
