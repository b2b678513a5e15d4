"""The group prior and its quadratic majorant, by rows.

At a map x the prior Σ r ‖∇x − s‖ lies under ½ Σ v ‖∇x − s‖² + constant with the stiffness
v = r / max(‖∇x − s‖, ε), touching it there where ‖∇x − s‖ ≥ ε. `up` holds the squared weights of the six
differences by column, 0 where a difference leaves the image: one table for ordinary rows, one for the last
row but one and one for the last. Away from the first and the last two columns a row's weights are the same
everywhere, so a row is walked in runs of columns for which they are constants.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from solver.kernels.view import view

PAD = 2
"""The widest difference spans two pixels."""

ROWS, COLUMNS = (0, 1, 1, 1, 0, 2), (1, 0, 1, -1, 2, 0)
"""The differences' offsets."""

RUNS = 4
"""Runs of columns with the same weights: the first one, the inner ones, the last but one and the last."""


@njit
def run(t, n):  # type: ignore[no-untyped-def]
    """(first column, how many) of run t in a row of n."""
    ends = (0, min(1, n), max(min(1, n), n - 2), max(min(1, n), n - 1), n)
    return ends[t], ends[t + 1] - ends[t]


@njit
def weights_at(up, kind, column):  # type: ignore[no-untyped-def]
    """The six weights of a column in the table `kind`, that of a row."""
    near = up[kind, 0, column], up[kind, 1, column], up[kind, 2, column]
    return (*near, up[kind, 3, column], up[kind, 4, column], up[kind, 5, column])


@njit(fastmath=True, error_model="numpy")
def add_squares(c, i, x, slope, up, kind, squares):  # type: ignore[no-untyped-def]
    """Add one channel's ‖∇x − slope‖² at row i; `kind` is the table of this row."""
    for t in range(RUNS):
        first, m = run(t, squares.size)
        if m > 0:
            _add_squares(c, i, first, m, x, slope, weights_at(up, kind, first), squares)


@njit(fastmath=True, error_model="numpy")
def _add_squares(c, i, first, m, x, slope, weights, squares):  # type: ignore[no-untyped-def]
    a, at, next1, next2 = first + 2, (c, i), (c, i + 1), (c, i + 2)
    here, right, right2 = view(x, at, a, m), view(x, at, a + 1, m), view(x, at, a + 2, m)
    down, diagonal = view(x, next1, a, m), view(x, next1, a + 1, m)
    antidiagonal, down2, out = view(x, next1, a - 1, m), view(x, next2, a, m), view(squares, (), first, m)
    w0, w1, w2, w3, w4, w5 = weights
    if slope.shape[2] > 0:
        fall, run = view(slope, (c, 0, i), a, m), view(slope, (c, 1, i), a, m)
        for j in range(m):
            v, s, r = here[j], fall[j], run[j]
            g0, g1, g2 = v - right[j] + r, v - down[j] + s, v - diagonal[j] + s + r
            g3, g4, g5 = v - antidiagonal[j] + s - r, v - right2[j] + r + r, v - down2[j] + s + s
            near = w0 * g0 * g0 + w1 * g1 * g1 + w2 * g2 * g2
            out[j] += near + w3 * g3 * g3 + w4 * g4 * g4 + w5 * g5 * g5
    else:
        for j in range(m):
            v = here[j]
            g0, g1, g2 = v - right[j], v - down[j], v - diagonal[j]
            g3, g4, g5 = v - antidiagonal[j], v - right2[j], v - down2[j]
            near = w0 * g0 * g0 + w1 * g1 * g1 + w2 * g2 * g2
            out[j] += near + w3 * g3 * g3 + w4 * g4 * g4 + w5 * g5 * g5


@njit(fastmath=True, error_model="numpy")
def stiffen(squares, radius, epsilon, stiffness, sums):  # type: ignore[no-untyped-def]
    """stiffness ← r / max(‖∇x − s‖, ε); add Σ r h(‖∇x − s‖) and a bound of Σ r (h(‖·‖) − ‖·‖).

    h is the absolute value with its corner rounded to the parabola t² / (2 ε) + ε / 2 under ε.
    """
    floor = epsilon * epsilon
    whole = part = squares.dtype.type(0)
    for j in range(squares.size):
        norm = np.sqrt(max(squares[j], floor))
        slack = radius[j] / norm
        stiffness[j] = slack
        whole += radius[j] * norm
        part += slack * squares[j]
    sums[0] += 0.5 * (float(whole) + float(part))
    sums[1] += 0.5 * (float(whole) - float(part))


@njit(nogil=True, cache=True)
def norms(rank, size, x, slope, up, out):  # type: ignore[no-untyped-def]
    """out (rows + 4, columns + 4) ← ‖∇x − slope‖₂ by pixel, all channels in one group."""
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    squares = np.zeros(n, x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        squares[:] = 0
        for c in range(channels):
            add_squares(c, row + 2, x, slope, up, max(0, row + 3 - rows), squares)
        for j in range(n):
            out[row + 2, j + 2] = np.sqrt(squares[j])


def tables(weights: NDArray[np.floating], columns: int) -> NDArray[np.floating]:
    """`up` for an image of this many columns: the squared weights (6,), 0 where a difference leaves it."""
    up = np.empty((3, 6, columns), weights.dtype)
    up[:] = (weights**2)[:, None]
    up[:, [0, 2], columns - 1 :] = 0
    up[:, 3, :1] = 0
    up[:, 4, max(0, columns - 2) :] = 0
    up[1:, 5] = 0
    up[2, 1:4] = 0
    return up
