"""How far a map is from its samples, and how far noise alone would keep it. Images as in `kernels.pairs`."""

import numpy as np
from numba import njit

from solver.kernels.view import view


@njit(fastmath=True)
def _turn(z, pull, curvature, weight, i, turned, expected):  # type: ignore[no-untyped-def]
    """turned ← Im conj(Z) pull, expected ← weight · curvature · |Z|², of row i."""
    n = turned.size
    a, b = view(z, (0, i), 2, n), view(z, (1, i), 2, n)
    s, t, m = view(pull, (0, i), 2, n), view(pull, (1, i), 2, n), view(curvature, (i,), 2, n)
    for j in range(n):
        turned[j] = a[j] * t[j] - b[j] * s[j]
        expected[j] = weight * m[j] * (a[j] * a[j] + b[j] * b[j])


@njit(fastmath=True)
def _gather(turned, expected, total, squares, noise):  # type: ignore[no-untyped-def]
    for j in range(turned.size):
        total[j] += turned[j]
        squares[j] += turned[j] * turned[j]
        noise[j] += expected[j]


@njit(nogil=True, cache=True)
def turn(rank, size, z, pull, curvature, weight, factor, out):  # type: ignore[no-untyped-def]
    """out (3, rows / factor, columns / factor) ← sums over cells of factor × factor pixels; by a team.

    Of what the data turn φ by, of its squares, and of the variance that noise alone would give it if each
    pixel had its own: with samples of variance 1 / weight each over its Ω, pull = weight · AᵀΩ noise
    has the covariance weight · AᵀΩA.

    Args:
        z: (2, rows + 4, columns + 4), the phasors.
        pull: (2, rows + 4, columns + 4), the data term's gradient in Z.
        curvature: (rows + 4, columns + 4), padded by 2, row sums of AᵀΩA.
        weight: a number.
        factor: pixels.
        out: (3, rows / factor, columns / factor).
    """
    cells, across = out.shape[1:]
    lines = np.empty((2, across * factor), out.dtype)
    sums = np.zeros((3, across * factor), out.dtype)
    for cell in range(rank * cells // size, (rank + 1) * cells // size):
        sums[:] = 0
        for row in range(cell * factor, (cell + 1) * factor):
            _turn(z, pull, curvature, weight, row + 2, lines[0], lines[1])
            _gather(lines[0], lines[1], sums[0], sums[1], sums[2])
        for kind in range(3):
            for j in range(across):
                out[kind, cell, j] = sums[kind, j * factor : (j + 1) * factor].sum()
