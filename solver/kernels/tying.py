"""Ties between neighbours: ½ Σ t (G X − s)² with a strength t for every difference G of the prior.

Images are padded as in `kernels.group`. Strengths are kept as `levels`, bytes (6, rows + 4, columns + 4),
0 in the padding and where a difference leaves the image, and the `unit` (6,) of each difference's levels: an
iteration waits for memory, and bytes are a quarter of it.
"""

import numpy as np
from numba import njit

from solver.kernels.group import COLUMNS, ROWS
from solver.kernels.view import view


@njit(fastmath=True)
def _add_both(own, other, by, out):  # type: ignore[no-untyped-def]
    n, kind = out.size, out.dtype.type
    a, b, target = own[:n], other[:n], out[:n]
    for j in range(n):
        target[j] += by * (kind(a[j]) + kind(b[j]))


@njit(nogil=True, cache=True)
def add_diagonal(rank, threads, levels, unit, out):  # type: ignore[no-untyped-def]
    """out += the diagonal of Gᵀ t G; by a team.

    Args:
        levels: (6, rows + 4, columns + 4), bytes, strengths in steps of `unit`.
        unit: (6,), a step of each difference's strengths.
        out: (rows + 4, columns + 4), padded by 2.
    """
    rows, n = out.shape[0] - 4, out.shape[1] - 4
    for i in range(rank * rows // threads + 2, (rank + 1) * rows // threads + 2):
        for k in range(6):
            down, right = ROWS[k], COLUMNS[k]
            own, other = levels[k, i, 2 : 2 + n], levels[k, i - down, 2 - right : 2 - right + n]
            _add_both(own, other, unit[k], out[i, 2 : 2 + n])


@njit(fastmath=True)
def _pull_along(c, i, x, levels, unit, out):  # type: ignore[no-untyped-def]
    """The part of `pull` along rows, row i."""
    n, kind, at = out.size, x.dtype.type, (c, i)
    here, right, left = view(x, at, 2, n), view(x, at, 3, n), view(x, at, 1, n)
    right2, left2 = view(x, at, 4, n), view(x, at, 0, n)
    r, b = view(levels, (0, i), 2, n), view(levels, (0, i), 1, n)
    r2, b2 = view(levels, (4, i), 2, n), view(levels, (4, i), 0, n)
    u0, u4 = unit[0], unit[4]
    for j in range(n):
        v = here[j]
        near = kind(r[j]) * (v - right[j]) + kind(b[j]) * (v - left[j])
        out[j] += u0 * near + u4 * (kind(r2[j]) * (v - right2[j]) + kind(b2[j]) * (v - left2[j]))


@njit(fastmath=True)
def _pull_across(c, i, x, levels, unit, out):  # type: ignore[no-untyped-def]
    """The part of `pull` along columns, row i."""
    n, kind = out.size, x.dtype.type
    here, down, above = view(x, (c, i), 2, n), view(x, (c, i + 1), 2, n), view(x, (c, i - 1), 2, n)
    down2, above2 = view(x, (c, i + 2), 2, n), view(x, (c, i - 2), 2, n)
    d, a = view(levels, (1, i), 2, n), view(levels, (1, i - 1), 2, n)
    d2, a2 = view(levels, (5, i), 2, n), view(levels, (5, i - 2), 2, n)
    u1, u5 = unit[1], unit[5]
    for j in range(n):
        v = here[j]
        near = kind(d[j]) * (v - down[j]) + kind(a[j]) * (v - above[j])
        out[j] += u1 * near + u5 * (kind(d2[j]) * (v - down2[j]) + kind(a2[j]) * (v - above2[j]))


@njit(fastmath=True)
def _pull_diagonal(c, i, x, levels, unit, out):  # type: ignore[no-untyped-def]
    """The part of `pull` along diagonals, row i."""
    n, kind = out.size, x.dtype.type
    here = view(x, (c, i), 2, n)
    diagonal, corner = view(x, (c, i + 1), 3, n), view(x, (c, i - 1), 1, n)
    antidiagonal, other = view(x, (c, i + 1), 1, n), view(x, (c, i - 1), 3, n)
    d, e = view(levels, (2, i), 2, n), view(levels, (2, i - 1), 1, n)
    a, o = view(levels, (3, i), 2, n), view(levels, (3, i - 1), 3, n)
    u2, u3 = unit[2], unit[3]
    for j in range(n):
        v = here[j]
        near = kind(d[j]) * (v - diagonal[j]) + kind(e[j]) * (v - corner[j])
        out[j] += u2 * near + u3 * (kind(a[j]) * (v - antidiagonal[j]) + kind(o[j]) * (v - other[j]))


@njit(fastmath=True)
def pull(top, end, c, x, levels, unit, out):  # type: ignore[no-untyped-def]
    """out += Gᵀ t G x in rows top to end of channel c."""
    for i in range(top + 2, end + 2):
        target = view(out, (c, i), 2, x.shape[2] - 4)
        _pull_along(c, i, x, levels, unit, target)
        _pull_across(c, i, x, levels, unit, target)
        _pull_diagonal(c, i, x, levels, unit, target)


@njit(nogil=True, cache=True)
def pull_all(rank, threads, x, levels, unit, out):  # type: ignore[no-untyped-def]
    """out += Gᵀ t G x, every channel; by a team.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        levels: (6, rows + 4, columns + 4), bytes, strengths in steps of `unit`.
        unit: (6,), a step of each difference's strengths.
        out: (C, rows + 4, columns + 4), padded by 2.
    """
    rows = x.shape[1] - 4
    for c in range(x.shape[0]):
        pull(rank * rows // threads, (rank + 1) * rows // threads, c, x, levels, unit, out)


@njit(fastmath=True)
def _lift_row(k, i, slope, levels, by, out):  # type: ignore[no-untyped-def]
    n, kind = out.size, out.dtype.type
    down, right = ROWS[k], COLUMNS[k]
    own, other = levels[k, i, 2 : 2 + n], levels[k, i - down, 2 - right : 2 - right + n]
    fall0, run0 = slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n]
    fall1, run1 = slope[0, i - down, 2 - right : 2 - right + n], slope[1, i - down, 2 - right : 2 - right + n]
    l, m = kind(down) * by, kind(right) * by  # noqa: E741
    for j in range(n):
        gain = kind(own[j]) * (l * fall0[j] + m * run0[j])
        out[j] += gain - kind(other[j]) * (l * fall1[j] + m * run1[j])


@njit(nogil=True, cache=True)
def lift(rank, threads, slope, levels, unit, out):  # type: ignore[no-untyped-def]
    """out += −Gᵀ t s, all channels: what the slope adds to `pull`; by a team.

    Args:
        slope: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column.
        levels: (6, rows + 4, columns + 4), bytes, strengths in steps of `unit`.
        unit: (6,), a step of each difference's strengths.
        out: (C, rows + 4, columns + 4), padded by 2.
    """
    rows, n = out.shape[1] - 4, out.shape[2] - 4
    for i in range(rank * rows // threads + 2, (rank + 1) * rows // threads + 2):
        for c in range(out.shape[0]):
            for k in range(6):
                _lift_row(k, i, slope[c], levels, unit[k], out[c, i, 2 : 2 + n])


@njit(fastmath=True)
def _sum_row(k, i, x, slope, levels, sums):  # type: ignore[no-untyped-def]
    n, kind = x.shape[1] - 4, x.dtype.type
    down, right = kind(ROWS[k]), kind(COLUMNS[k])
    here, there = x[i, 2 : 2 + n], x[i + ROWS[k], 2 + COLUMNS[k] : 2 + COLUMNS[k] + n]
    fall, run, own = slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n], levels[k, i, 2 : 2 + n]
    squares = rest = kind(0)
    for j in range(n):
        change, tilt, level = here[j] - there[j], down * fall[j] + right * run[j], kind(own[j])
        squares += level * (change + tilt) * (change + tilt)
        rest += level * (tilt + change) * (tilt - change)
    sums[0] += squares
    sums[1] += rest


@njit(nogil=True, cache=True)
def sums(rank, threads, x, slope, levels, unit, out):  # type: ignore[no-untyped-def]
    """out += ½ Σ t (G x − s)² and ½ Σ t (s² − (G x)²) by row, all channels; by a team.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column.
        levels: (6, rows + 4, columns + 4), bytes, strengths in steps of `unit`.
        unit: (6,), a step of each difference's strengths.
        out: (rows, 2), in float64.
    """
    part, rows = np.zeros(2), out.shape[0]
    for row in range(rank * rows // threads, (rank + 1) * rows // threads):
        for k in range(6):
            part[:] = 0
            for c in range(x.shape[0]):
                _sum_row(k, row + 2, x[c], slope[c], levels, part)
            out[row] += 0.5 * float(unit[k]) * part
