"""How far a map is from its samples, and how far noise alone would keep it. Images as in `kernels.pairs`."""

import numpy as np
from numba import njit

from solver.kernels.view import view


@njit(fastmath=True)
def _compare(z, pull, bend, weight, i, squares, expected):  # type: ignore[no-untyped-def]
    """squares ← (Im conj(Z) pull)², expected ← weight · bend · |Z|², of row i."""
    n = squares.size
    a, b = view(z, (0, i), 2, n), view(z, (1, i), 2, n)
    s, t, m = view(pull, (0, i), 2, n), view(pull, (1, i), 2, n), view(bend, (i,), 2, n)
    for j in range(n):
        turned = a[j] * t[j] - b[j] * s[j]
        squares[j] = turned * turned
        expected[j] = weight * m[j] * (a[j] * a[j] + b[j] * b[j])


@njit(nogil=True, cache=True)
def compare(rank, size, z, pull, bend, weight, factor, out):  # type: ignore[no-untyped-def]
    """out (2, rows / factor, columns / factor) ← sums over cells of factor × factor pixels; by a team.

    Of the squares of what the data turn φ by, and of what noise alone would make of these: with samples of
    variance 1 / weight, pull = weight · Aᵀ noise has the variance weight · diag(AᵀA).

    Args:
        z: (2, rows + 4, columns + 4), the phasors.
        pull: (2, rows + 4, columns + 4), the data term's gradient in Z.
        bend: (rows + 4, columns + 4), padded by 2, diag(AᵀA).
        weight: a number.
        factor: pixels.
        out: (2, rows / factor, columns / factor).
    """
    cells, across = out.shape[1:]
    lines, sums = np.empty((2, across * factor), out.dtype), np.zeros((2, across * factor), out.dtype)
    for cell in range(rank * cells // size, (rank + 1) * cells // size):
        sums[:] = 0
        for row in range(cell * factor, (cell + 1) * factor):
            _compare(z, pull, bend, weight, row + 2, lines[0], lines[1])
            sums += lines
        for kind in range(2):
            for j in range(across):
                out[kind, cell, j] = sums[kind, j * factor : (j + 1) * factor].sum()
