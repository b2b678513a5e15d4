"""The group prior and its quadratic majorant, by rows.

At a map x the prior Σ r ‖∇x − s‖ lies under ½ Σ v ‖∇x − s‖² + constant with the stiffness
v = r / max(‖∇x − s‖, ε), touching it there where ‖∇x − s‖ ≥ ε. `up` holds the squared weights of the six
differences by column, 0 where a difference leaves the image: one table for ordinary rows, one for the last
row but one and one for the last. The loops here have a row's weights as constants, and instead of the columns
of that table one row of ones and zeros, `inside`, which they read where a difference ends.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from solver.kernels.view import view

PAD = 2
"""The widest difference spans two pixels."""

ROWS, COLUMNS = (0, 1, 1, 1, 0, 2), (1, 0, 1, -1, 2, 0)
"""The differences' offsets."""


@njit
def inside(n, kind):  # type: ignore[no-untyped-def]
    """(n + 4,): 1 within a row of n pixels, 0 in its padding."""
    out = np.zeros(n + 4, kind)
    out[2 : 2 + n] = 1
    return out


@njit
def weights_at(row, rows, weights):  # type: ignore[no-untyped-def]
    """The six squared weights of a row, 0 where a difference leaves the image below."""
    one, two = weights.dtype.type(row + 1 < rows), weights.dtype.type(row + 2 < rows)
    near = weights[0], one * weights[1], one * weights[2]
    return (*near, one * weights[3], weights[4], two * weights[5])


@njit(fastmath=True, error_model="numpy")
def add_squares(c, i, x, slope, own, inside, squares):  # type: ignore[no-untyped-def]
    """Add one channel's ‖∇x − slope‖² at row i, whose weights are `own`."""
    n, a, at, next1, next2 = squares.size, 2, (c, i), (c, i + 1), (c, i + 2)
    here, right, right2 = view(x, at, a, n), view(x, at, a + 1, n), view(x, at, a + 2, n)
    down, diagonal = view(x, next1, a, n), view(x, next1, a + 1, n)
    antidiagonal, down2 = view(x, next1, a - 1, n), view(x, next2, a, n)
    one, two, back = view(inside, (), a + 1, n), view(inside, (), a + 2, n), view(inside, (), a - 1, n)
    w0, w1, w2, w3, w4, w5 = own
    if slope.shape[2] > 0:
        fall, run = view(slope, (c, 0, i), a, n), view(slope, (c, 1, i), a, n)
        for j in range(n):
            v, s, r = here[j], fall[j], run[j]
            g0, g1, g2 = v - right[j] + r, v - down[j] + s, v - diagonal[j] + s + r
            g3, g4, g5 = v - antidiagonal[j] + s - r, v - right2[j] + r + r, v - down2[j] + s + s
            near = one[j] * (w0 * g0 * g0 + w2 * g2 * g2) + w1 * g1 * g1
            squares[j] += near + back[j] * w3 * g3 * g3 + two[j] * w4 * g4 * g4 + w5 * g5 * g5
    else:
        for j in range(n):
            v = here[j]
            g0, g1, g2 = v - right[j], v - down[j], v - diagonal[j]
            g3, g4, g5 = v - antidiagonal[j], v - right2[j], v - down2[j]
            near = one[j] * (w0 * g0 * g0 + w2 * g2 * g2) + w1 * g1 * g1
            squares[j] += near + back[j] * w3 * g3 * g3 + two[j] * w4 * g4 * g4 + w5 * g5 * g5


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
def norms(rank, size, x, slope, weights, out):  # type: ignore[no-untyped-def]
    """out (rows + 4, columns + 4) ← ‖∇x − slope‖₂ by pixel, all channels in one group.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column, or (C, 2, 0,
            0) = level.
        weights: (6,), the squared weights of the differences, 1 / pixel².
        out: (rows + 4, columns + 4), padded by 2.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    squares, within = np.zeros(n, x.dtype), inside(n, x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        squares[:] = 0
        for c in range(channels):
            add_squares(c, row + 2, x, slope, weights_at(row, rows, weights), within, squares)
        for j in range(n):
            out[row + 2, j + 2] = np.sqrt(squares[j])


@njit(fastmath=True)
def _weighed(squares, radius):  # type: ignore[no-untyped-def]
    total = squares.dtype.type(0)
    for j in range(squares.size):
        total += radius[j] * np.sqrt(squares[j])
    return total


@njit(nogil=True, cache=True)
def values(rank, size, x, slope, weights, radius, sums):  # type: ignore[no-untyped-def]
    """sums ← Σ radius ‖∇x − slope‖₂ by row.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column, or (C, 2, 0,
            0) = level.
        weights: (6,), the squared weights of the differences, 1 / pixel².
        radius: (rows + 4, columns + 4), padded by 2, λ by pixel in units of λ.
        sums: (rows,), in float64.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    squares, within = np.zeros(n, x.dtype), inside(n, x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        squares[:] = 0
        for c in range(channels):
            add_squares(c, row + 2, x, slope, weights_at(row, rows, weights), within, squares)
        sums[row] = _weighed(squares, radius[row + 2, 2 : 2 + n])


def tables(weights: NDArray[np.floating], columns: int) -> NDArray[np.floating]:
    """`up` for an image of this many columns: the squared weights (6,), 0 where a difference leaves it."""
    up = np.empty((3, 6, columns), weights.dtype)
    up[:] = (weights**2)[:, None]
    up[:, 0:3:2, columns - 1 :] = 0
    up[:, 3, :1] = 0
    up[:, 4, max(0, columns - 2) :] = 0
    up[1:, 5] = 0
    up[2, 1:4] = 0
    return up
