"""The loop of `solver.memory_gradient`, walked by a team of threads.

Each thread has its rows; sums are kept by row and added in order by every thread for itself, so all take the
same decisions, and results are the same bits for any number of threads.
"""

import hashlib
from pathlib import Path

import numpy as np
from numba import njit

from solver.kernels.blur import apply, rings
from solver.kernels.direction import descend
from solver.kernels.step import advance, bends
from solver.kernels.team import meet
from solver.kernels.ties import pull

EPSILON, FIT, DONE, SETTLED = range(4)
"""Places in the numbers that the loop takes and leaves."""

STRIP = 16
"""Rows whose products are made and used before they leave the cache."""


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
    span = max(least, count // 3)
    if count <= 2 * span:
        return np.inf
    last, before, first = history[count - 1], history[count - 1 - span], history[count - 1 - 2 * span]
    older, later = max(first - before, 0.0), max(before - last, 0.0)
    ratio = min(later / older, 0.95) if older > 0 else 0.0
    return later * max(1.0, 3 * ratio / (1 - ratio))


def _compiled(sources: str):  # type: ignore[no-untyped-def]
    """The loop; its place in Numba's cache goes by the sources that are compiled into it."""

    @njit(nogil=True, cache=True)
    def iterate(  # type: ignore[no-untyped-def]
        rank, size, barrier, x, slope, radius, up, weights, curvature, footprint, ties, data, step, work,
        sums, rule, numbers, history
    ):  # fmt: skip
        """Iterate until the objective has settled or `history` is full.

        Args:
            x: the map, (C, rows + 4, columns + 4), padded by 2 as all images are; in place.
            slope, radius, up, weights, curvature, step: see `direction.descend`.
            footprint: (stencil, side, taps, size) of `blur.apply`; no stencil = a diagonal operator, whose
                diagonal is the curvature and whose data is the map that it draws to.
            ties: (levels, unit, lift) of `kernels.ties`; no levels = none.
            data: (C, …), the data term's gradient, kept up to date; or that map.
            work: (direction (C, …), its product with the operator, the step's, stiffness (…)).
            sums: (2, rows, 6).
            rule: (tolerance, part that the rounding may hide, fall of ε, patience, iterations to a refresh,
                least iterations of a fall).
            numbers: (4,) in and out: ε, value of the data term, iterations, 1 = settled.
            history: objectives by iteration, out.
        """
        sources  # noqa: B018
        stencil, side, taps, taps_size = footprint
        levels, unit, lift = ties
        direction, curved, curved_step, stiffness = work
        tolerance, hide, fall_of_epsilon, patience, refresh, span = rule
        channels, rows, tied = x.shape[0], x.shape[1] - 4, levels.shape[1] > 0
        diagonal, two, none = stencil.shape[1] == 0, x.dtype.type(2), np.zeros((0, 0), x.dtype)
        rows_of = [rings(x.shape[2] - 4, taps, taps_size) for _ in range(channels)]
        top, end = rank * rows // size, (rank + 1) * rows // size
        epsilon, fit, count = numbers[EPSILON], numbers[FIT], int(numbers[DONE])
        own, settled = history.copy(), False
        while count < history.size and not settled:
            if not diagonal and count % refresh == 0:
                for c in range(channels):
                    apply(top, end, x[c], stencil, side[c], taps, taps_size, two, rows_of[c], False, data[c])
                    if tied:
                        pull(top, end, x[c], levels, unit, data[c])
                        data[c, top + 2 : end + 2] += lift[c, top + 2 : end + 2]
            descend(
                top, end, x, slope, radius, x.dtype.type(epsilon), up, weights, curvature, diagonal, data,
                step, stiffness, direction, sums[0]
            )  # fmt: skip
            meet(barrier, size)
            for strip in range(top, end, STRIP):
                until = min(strip + STRIP, end)
                if not diagonal:
                    for c in range(channels):
                        apply(
                            strip, until, direction[c], stencil, none, taps, taps_size, two, rows_of[c],
                            strip > top, curved[c]
                        )  # fmt: skip
                        if tied:
                            pull(strip, until, direction[c], levels, unit, curved[c])
                bends(
                    strip, until, direction, step, curvature, diagonal, curved, curved_step, stiffness, up,
                    sums[1]
                )  # fmt: skip
            meet(barrier, size)
            roughness, hidden, along, across, data_along, data_across = _total(sums[0])
            s = _total(sums[1])
            a, b = least(along, across, s[0] + s[3], s[1] + s[4], s[2] + s[5])
            advance(
                top, end, x.dtype.type(a), x.dtype.type(b), x, diagonal, data, direction, step, curved,
                curved_step
            )  # fmt: skip
            value = fit + roughness
            own[count] = value
            count += 1
            fit += a * data_along + b * data_across
            fit += 0.5 * (a * a * s[3] + 2 * a * b * s[4] + b * b * s[5])
            left = error(own, count, span)
            settled = hidden <= hide * value and left <= tolerance * value
            if hidden > max(0.5 * hide * value, patience * left if left < np.inf else 0.0):
                epsilon *= fall_of_epsilon
            meet(barrier, size)
        if rank == 0:
            history[:] = own
            numbers[EPSILON], numbers[FIT], numbers[DONE], numbers[SETTLED] = epsilon, fit, count, settled

    return iterate


def _sources() -> str:
    digest = hashlib.sha256()
    for name in ("blur", "direction", "prior", "step", "team", "ties"):
        digest.update((Path(__file__).parent / f"{name}.py").read_bytes())
    return digest.hexdigest()


iterate = _compiled(_sources())
