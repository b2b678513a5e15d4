"""Ties between neighbours: ½ Σ t (G X − s)² with a strength t for every difference G of the prior.

Images are padded as in `kernels.prior`; `ties` (6, rows + 4, columns + 4) are 0 in the padding and where a
difference leaves the image.
"""

import numpy as np
from numba import njit, prange

from solver.kernels.prior import COLUMNS, ROWS


@njit(parallel=True, fastmath=True, cache=True)
def differences(x, slope, up, out):  # type: ignore[no-untyped-def]
    """out (6, rows + 4, columns + 4) ← |G x − s| over all channels, 0 where it leaves the image.

    Args: x (C, …); slope (C, 2, …); up, the squared weights, as in `kernels.prior`.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    for row in prange(rows):
        i, weights = row + 2, up[max(0, row + 3 - rows)]
        for k in range(6):
            down, right = x.dtype.type(ROWS[k]), x.dtype.type(COLUMNS[k])
            target, weight = out[k, i, 2 : 2 + n], weights[k]
            target[:] = 0
            for c in range(channels):
                here, there = x[c, i, 2 : 2 + n], x[c, i + ROWS[k], 2 + COLUMNS[k] : 2 + COLUMNS[k] + n]
                fall, run = slope[c, 0, i, 2 : 2 + n], slope[c, 1, i, 2 : 2 + n]
                for j in range(n):
                    difference = here[j] - there[j] + down * fall[j] + right * run[j]
                    target[j] += difference * difference
            for j in range(n):
                target[j] = np.sqrt(weight[j] * target[j])


@njit(fastmath=True)
def _pull_near(i, x, ties, out):  # type: ignore[no-untyped-def]
    """The part of `pull` along rows and columns, row i."""
    n = out.size
    here, right, left = x[i, 2 : 2 + n], x[i, 3 : 3 + n], x[i, 1 : 1 + n]
    down, above = x[i + 1, 2 : 2 + n], x[i - 1, 2 : 2 + n]
    right2, left2, down2, above2 = x[i, 4 : 4 + n], x[i, 0:n], x[i + 2, 2 : 2 + n], x[i - 2, 2 : 2 + n]
    r, b, d, a = (
        ties[0, i, 2 : 2 + n],
        ties[0, i, 1 : 1 + n],
        ties[1, i, 2 : 2 + n],
        ties[1, i - 1, 2 : 2 + n],
    )
    r2, b2 = ties[4, i, 2 : 2 + n], ties[4, i, 0:n]
    d2, a2 = ties[5, i, 2 : 2 + n], ties[5, i - 2, 2 : 2 + n]
    for j in range(n):
        v = here[j]
        near = r[j] * (v - right[j]) + b[j] * (v - left[j]) + d[j] * (v - down[j]) + a[j] * (v - above[j])
        far = r2[j] * (v - right2[j]) + b2[j] * (v - left2[j]) + d2[j] * (v - down2[j])
        out[j] += near + far + a2[j] * (v - above2[j])


@njit(fastmath=True)
def _pull_diagonal(i, x, ties, out):  # type: ignore[no-untyped-def]
    """The part of `pull` along diagonals, row i."""
    n = out.size
    here = x[i, 2 : 2 + n]
    diagonal, corner = x[i + 1, 3 : 3 + n], x[i - 1, 1 : 1 + n]
    antidiagonal, other = x[i + 1, 1 : 1 + n], x[i - 1, 3 : 3 + n]
    d, c = ties[2, i, 2 : 2 + n], ties[2, i - 1, 1 : 1 + n]
    a, o = ties[3, i, 2 : 2 + n], ties[3, i - 1, 3 : 3 + n]
    for j in range(n):
        v = here[j]
        near = d[j] * (v - diagonal[j]) + c[j] * (v - corner[j])
        out[j] += near + a[j] * (v - antidiagonal[j]) + o[j] * (v - other[j])


@njit(fastmath=True)
def pull(top, end, x, ties, out):  # type: ignore[no-untyped-def]
    """out += Gᵀ t G x in rows top to end, one channel."""
    n = x.shape[1] - 4
    for i in range(top + 2, end + 2):
        _pull_near(i, x, ties, out[i, 2 : 2 + n])
        _pull_diagonal(i, x, ties, out[i, 2 : 2 + n])


@njit(nogil=True, cache=True)
def pull_all(rank, threads, barrier, x, ties, out):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """`pull` in every channel by a team (see `kernels.team`)."""
    rows = x.shape[1] - 4
    for c in range(x.shape[0]):
        pull(rank * rows // threads, (rank + 1) * rows // threads, x[c], ties, out[c])


@njit(parallel=True, fastmath=True, cache=True)
def lift(slope, ties, out):  # type: ignore[no-untyped-def]
    """out += −Gᵀ t s, all channels: what the slope adds to `pull`."""
    channels, rows, n = out.shape[0], out.shape[1] - 4, out.shape[2] - 4
    for row in prange(rows):
        i = row + 2
        for c in range(channels):
            fall, run, target = slope[c, 0], slope[c, 1], out[c, i, 2 : 2 + n]
            for k in range(6):
                l, m = ROWS[k], COLUMNS[k]  # noqa: E741
                own, other = ties[k, i, 2 : 2 + n], ties[k, i - l, 2 - m : 2 - m + n]
                fall1, run1 = fall[i - l, 2 - m : 2 - m + n], run[i - l, 2 - m : 2 - m + n]
                fall0, run0 = fall[i, 2 : 2 + n], run[i, 2 : 2 + n]
                for j in range(n):
                    target[j] += own[j] * (l * fall0[j] + m * run0[j]) - other[j] * (
                        l * fall1[j] + m * run1[j]
                    )


@njit(parallel=True, cache=True)
def sums(x, slope, ties):  # type: ignore[no-untyped-def]
    """(2,) float64: ½ Σ t (G x − s)² and ½ Σ t (s² − (G x)²), all channels."""
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    parts = np.zeros((rows, 2))
    for row in prange(rows):
        i = row + 2
        for c in range(channels):
            for k in range(6):
                down, right = ROWS[k], COLUMNS[k]
                for j in range(2, 2 + n):
                    strength = 0.5 * float(ties[k, i, j])
                    change = float(x[c, i, j]) - float(x[c, i + down, j + right])
                    tilt = down * float(slope[c, 0, i, j]) + right * float(slope[c, 1, i, j])
                    parts[row, 0] += strength * (change + tilt) * (change + tilt)
                    parts[row, 1] += strength * (tilt + change) * (tilt - change)
    return parts.sum(axis=0)
