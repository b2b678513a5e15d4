"""The group prior and its quadratic majorant, by rows.

At a map x the prior Σ r ‖∇x − s‖ lies under ½ Σ v ‖∇x − s‖² + constant with the stiffness
v = r / max(‖∇x − s‖, ε), touching it there where ‖∇x − s‖ ≥ ε. `up` holds the squared weights of the six
differences by column, 0 where a difference leaves the image: one table for ordinary rows, one for the last
row but one and one for the last. Away from the first and the last two columns a row's weights are the same
everywhere: there they are constants of the loop, and the few columns at the border go by the table.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

PAD = 2
"""The widest difference spans two pixels."""

ROWS, COLUMNS = (0, 1, 1, 1, 0, 2), (1, 0, 1, -1, 2, 0)
"""The differences' offsets."""

_LEFT, _RIGHT = 1, 2
"""Columns at either border from which a difference leaves the image."""


@njit
def inside(n):  # type: ignore[no-untyped-def]
    """(first, end) of the columns from which no difference leaves the image sideways."""
    return (_LEFT, n - _RIGHT) if n > _LEFT + _RIGHT else (0, 0)


@njit
def border(t, first, end):  # type: ignore[no-untyped-def]
    """Column t of those outside [first, end)."""
    return t if t < first else t - first + end


@njit(fastmath=True)
def difference(i, j, k, x, slope):  # type: ignore[no-untyped-def]
    """Difference k at row i and column j, both counted with the padding, less what the slope foretells."""
    down, right = ROWS[k], COLUMNS[k]
    found = x[i, j] - x[i + down, j + right]
    if slope.shape[1] > 0:
        for _ in range(down):
            found += slope[0, i, j]
        for _ in range(abs(right)):
            found += slope[1, i, j] if right > 0 else -slope[1, i, j]
    return found


@njit(fastmath=True, error_model="numpy")
def add_squares(i, x, slope, up, squares):  # type: ignore[no-untyped-def]
    """Add one channel's ‖∇x − slope‖² at row i."""
    n = x.shape[1] - 4
    first, end = inside(n)
    for t in range(first + n - end):
        j = border(t, first, end)
        for k in range(6):
            found = difference(i, j + 2, k, x, slope)
            squares[j] += up[k, j] * found * found
    m, a = end - first, first + 2
    if m <= 0:
        return
    here, right, right2 = x[i, a : a + m], x[i, a + 1 : a + 1 + m], x[i, a + 2 : a + 2 + m]
    down, diagonal = x[i + 1, a : a + m], x[i + 1, a + 1 : a + 1 + m]
    antidiagonal, down2, out = x[i + 1, a - 1 : a - 1 + m], x[i + 2, a : a + m], squares[first:end]
    w0, w1, w2 = up[0, first], up[1, first], up[2, first]
    w3, w4, w5 = up[3, first], up[4, first], up[5, first]
    if slope.shape[1] > 0:
        fall, run = slope[0, i, a : a + m], slope[1, i, a : a + m]
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
    n = squares.size
    square, reach, out = squares[:n], radius[:n], stiffness[:n]
    floor = epsilon * epsilon
    whole = part = square.dtype.type(0)
    for j in range(n):
        norm = np.sqrt(max(square[j], floor))
        slack = reach[j] / norm
        out[j] = slack
        whole += reach[j] * norm
        part += slack * square[j]
    sums[0] += 0.5 * (float(whole) + float(part))
    sums[1] += 0.5 * (float(whole) - float(part))


@njit(fastmath=True)
def add_pull_forward(i, x, slope, up, stiffness, pulls, out):  # type: ignore[no-untyped-def]
    """Add what a pixel's own differences pull it by, row i; keep stiffness · slope (2, …) for later."""
    n = x.shape[1] - 4
    first, end = inside(n)
    for t in range(first + n - end):
        j = border(t, first, end)
        for k in range(6):
            out[j] += stiffness[j + 2] * up[k, j] * difference(i, j + 2, k, x, slope)
    if slope.shape[1] > 0:
        _keep(slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n], stiffness[2 : 2 + n], pulls)
    m, a = end - first, first + 2
    if m <= 0:
        return
    here, right, right2 = x[i, a : a + m], x[i, a + 1 : a + 1 + m], x[i, a + 2 : a + 2 + m]
    down, diagonal = x[i + 1, a : a + m], x[i + 1, a + 1 : a + 1 + m]
    antidiagonal, down2 = x[i + 1, a - 1 : a - 1 + m], x[i + 2, a : a + m]
    slack, target = stiffness[a : a + m], out[first:end]
    w0, w1, w2 = up[0, first], up[1, first], up[2, first]
    w3, w4, w5 = up[3, first], up[4, first], up[5, first]
    if slope.shape[1] > 0:
        fall, run = slope[0, i, a : a + m], slope[1, i, a : a + m]
        falls, runs = w1 + w2 + w3 + w5 + w5, w0 + w2 - w3 + w4 + w4
        for j in range(m):
            v = here[j]
            near = w0 * (v - right[j]) + w1 * (v - down[j]) + w2 * (v - diagonal[j])
            far = w3 * (v - antidiagonal[j]) + w4 * (v - right2[j]) + w5 * (v - down2[j])
            target[j] += slack[j] * (near + far + falls * fall[j] + runs * run[j])
    else:
        for j in range(m):
            v = here[j]
            near = w0 * (v - right[j]) + w1 * (v - down[j]) + w2 * (v - diagonal[j])
            far = w3 * (v - antidiagonal[j]) + w4 * (v - right2[j]) + w5 * (v - down2[j])
            target[j] += slack[j] * (near + far)


@njit(fastmath=True)
def _keep(fall, run, stiffness, pulls):  # type: ignore[no-untyped-def]
    n = stiffness.size
    slack, down, right = stiffness[:n], pulls[0, 2 : 2 + n], pulls[1, 2 : 2 + n]
    for j in range(n):
        down[j] = slack[j] * fall[j]
        right[j] = slack[j] * run[j]


@njit(fastmath=True)
def add_pull_backward(i, x, weights, stiff, stiff1, stiff2, out):  # type: ignore[no-untyped-def]
    """Add what the differences of the pixels before it pull a pixel by; stiffness of rows i, i − 1, i − 2."""
    n = x.shape[1] - 4
    here, left, left2 = x[i, 2 : 2 + n], x[i, 1 : 1 + n], x[i, 0:n]
    above, corner, other = x[i - 1, 2 : 2 + n], x[i - 1, 1 : 1 + n], x[i - 1, 3 : 3 + n]
    above2, target = x[i - 2, 2 : 2 + n], out[:n]
    v0, v4, v1, v2 = stiff[1 : 1 + n], stiff[0:n], stiff1[2 : 2 + n], stiff1[1 : 1 + n]
    v3, v5 = stiff1[3 : 3 + n], stiff2[2 : 2 + n]
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for j in range(n):
        v = here[j]
        near = w0 * v0[j] * (v - left[j]) + w1 * v1[j] * (v - above[j]) + w2 * v2[j] * (v - corner[j])
        far = w3 * v3[j] * (v - other[j]) + w4 * v4[j] * (v - left2[j]) + w5 * v5[j] * (v - above2[j])
        target[j] += near + far


@njit(fastmath=True)
def add_tilt_backward(pulls, pulls1, pulls2, weights, out):  # type: ignore[no-untyped-def]
    """The slope's part of `add_pull_backward`; weights (8,), the last two twice those of 4 and 5.

    Doubled weights come ready: doubled in here they kept the compiler from vectorising, at six times the
    cost.
    """
    n = out.size
    r0, r4, s1, s2 = pulls[1, 1 : 1 + n], pulls[1, 0:n], pulls1[0, 2 : 2 + n], pulls1[0, 1 : 1 + n]
    r2, s3, r3, s5 = pulls1[1, 1 : 1 + n], pulls1[0, 3 : 3 + n], pulls1[1, 3 : 3 + n], pulls2[0, 2 : 2 + n]
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[6], weights[7]
    target = out[:n]
    for j in range(n):
        near = w0 * r0[j] + w4 * r4[j] + w1 * s1[j] + w2 * s2[j]
        target[j] -= near + w3 * s3[j] + w2 * r2[j] - w3 * r3[j] + w5 * s5[j]


@njit(nogil=True, cache=True)
def norms(rank, size, x, slope, up, out):  # type: ignore[no-untyped-def]
    """out (rows + 4, columns + 4) ← ‖∇x − slope‖₂ by pixel, all channels in one group."""
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    squares = np.zeros(n, x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        squares[:] = 0
        for c in range(channels):
            add_squares(row + 2, x[c], slope[c], up[max(0, row + 3 - rows)], squares)
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
