"""The group prior and its quadratic majorant, by rows.

At a map x the prior Σ r ‖∇x − s‖ lies under ½ Σ v ‖∇x − s‖² + constant with the stiffness
v = r / max(‖∇x − s‖, ε), touching it there where ‖∇x − s‖ ≥ ε. `up` holds the squared weights of the six
differences by column, 0 where a difference leaves the image: one table for ordinary rows, one for the last
row but one and one for the last.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

PAD = 2
"""The widest difference spans two pixels."""

ROWS, COLUMNS = (0, 1, 1, 1, 0, 2), (1, 0, 1, -1, 2, 0)
"""The differences' offsets."""

_TILE_ROWS = 36
"""Rows walked together."""


@njit(fastmath=True, error_model="numpy")
def _add_squares(i, x, slope, up, squares):  # type: ignore[no-untyped-def]
    """Add one channel's ‖∇x − slope‖² at row i."""
    n = x.shape[1] - 4
    here, right, right2 = x[i, 2 : 2 + n], x[i, 3 : 3 + n], x[i, 4 : 4 + n]
    down, diagonal, antidiagonal = x[i + 1, 2 : 2 + n], x[i + 1, 3 : 3 + n], x[i + 1, 1 : 1 + n]
    down2, out = x[i + 2, 2 : 2 + n], squares[:n]
    # Differences down leave the image by whole rows, so their weights are the same in every column. Fewer
    # arrays also keep the compiler's test that none overlap within its limit.
    w0, w1, w2, w3, w4, w5 = up[0], up[1, 0], up[2], up[3], up[4], up[5, 0]
    if slope.shape[1] > 0:
        fall, run = slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n]
        for j in range(n):
            v, s, r = here[j], fall[j], run[j]
            g0, g1, g2 = v - right[j] + r, v - down[j] + s, v - diagonal[j] + s + r
            g3, g4, g5 = v - antidiagonal[j] + s - r, v - right2[j] + r + r, v - down2[j] + s + s
            near = w0[j] * g0 * g0 + w1 * g1 * g1 + w2[j] * g2 * g2
            out[j] += near + w3[j] * g3 * g3 + w4[j] * g4 * g4 + w5 * g5 * g5
    else:
        for j in range(n):
            v = here[j]
            g0, g1, g2 = v - right[j], v - down[j], v - diagonal[j]
            g3, g4, g5 = v - antidiagonal[j], v - right2[j], v - down2[j]
            near = w0[j] * g0 * g0 + w1 * g1 * g1 + w2[j] * g2 * g2
            out[j] += near + w3[j] * g3 * g3 + w4[j] * g4 * g4 + w5 * g5 * g5


@njit(fastmath=True, error_model="numpy")
def _stiffen(squares, radius, epsilon, stiffness, sums):  # type: ignore[no-untyped-def]
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
def _forward(i, x, up, stiffness, out):  # type: ignore[no-untyped-def]
    """Add what a pixel's own differences pull it by, row i."""
    n = x.shape[1] - 4
    here, right, right2 = x[i, 2 : 2 + n], x[i, 3 : 3 + n], x[i, 4 : 4 + n]
    down, diagonal, antidiagonal = x[i + 1, 2 : 2 + n], x[i + 1, 3 : 3 + n], x[i + 1, 1 : 1 + n]
    down2, slack, target = x[i + 2, 2 : 2 + n], stiffness[2 : 2 + n], out[:n]
    w0, w1, w2, w3, w4, w5 = up[0], up[1, 0], up[2], up[3], up[4], up[5, 0]
    for j in range(n):
        v = here[j]
        near = w0[j] * (v - right[j]) + w1 * (v - down[j]) + w2[j] * (v - diagonal[j])
        far = w3[j] * (v - antidiagonal[j]) + w4[j] * (v - right2[j]) + w5 * (v - down2[j])
        target[j] += slack[j] * (near + far)


@njit(fastmath=True)
def _backward(i, x, weights, stiff, stiff1, stiff2, out):  # type: ignore[no-untyped-def]
    """Add what the differences of the pixels before it pull a pixel by; stiffness of rows i, i − 1, i − 2."""
    n = x.shape[1] - 4
    here, left, left2 = x[i, 2 : 2 + n], x[i, 1 : 1 + n], x[i, 0:n]
    above, corner, other, above2 = (
        x[i - 1, 2 : 2 + n],
        x[i - 1, 1 : 1 + n],
        x[i - 1, 3 : 3 + n],
        x[i - 2, 2 : 2 + n],
    )
    v0, v4, v1, v2 = stiff[1 : 1 + n], stiff[0:n], stiff1[2 : 2 + n], stiff1[1 : 1 + n]
    v3, v5, target = stiff1[3 : 3 + n], stiff2[2 : 2 + n], out[:n]
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for j in range(n):
        v = here[j]
        near = w0 * v0[j] * (v - left[j]) + w1 * v1[j] * (v - above[j]) + w2 * v2[j] * (v - corner[j])
        far = w3 * v3[j] * (v - other[j]) + w4 * v4[j] * (v - left2[j]) + w5 * v5[j] * (v - above2[j])
        target[j] += near + far


@njit(fastmath=True)
def _tilt_forward(slope, i, sums, stiffness, pulls, out):  # type: ignore[no-untyped-def]
    """The slope's part of `_forward`; keeps stiffness · slope (2, columns) for `_tilt_backward`."""
    n = out.size
    fall, run, slack, target = slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n], stiffness[2 : 2 + n], out[:n]
    down, right, falls, runs = pulls[0, 2 : 2 + n], pulls[1, 2 : 2 + n], sums[0], sums[1]
    for j in range(n):
        down[j] = slack[j] * fall[j]
    for j in range(n):
        right[j] = slack[j] * run[j]
    for j in range(n):
        target[j] += falls[j] * down[j] + runs[j] * right[j]


@njit(fastmath=True)
def _tilt_backward(pulls, pulls1, pulls2, weights, out):  # type: ignore[no-untyped-def]
    """The slope's part of `_backward`."""
    n = out.size
    r0, r4, s1, s2 = pulls[1, 1 : 1 + n], pulls[1, 0:n], pulls1[0, 2 : 2 + n], pulls1[0, 1 : 1 + n]
    r2, s3, r3, s5 = pulls1[1, 1 : 1 + n], pulls1[0, 3 : 3 + n], pulls1[1, 3 : 3 + n], pulls2[0, 2 : 2 + n]
    w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
    w4, w5, target = weights[4] + weights[4], weights[5] + weights[5], out[:n]
    for j in range(n):
        near = w0 * r0[j] + w1 * s1[j] + w2 * (s2[j] + r2[j])
        target[j] -= near + w3 * (s3[j] - r3[j]) + w4 * r4[j] + w5 * s5[j]


@njit(fastmath=True, error_model="numpy")
def _precondition(stiff, stiff1, stiff2, total, weights, curvature, out):  # type: ignore[no-untyped-def]
    """out = −1 / (curvature of the data + diagonal of the majorant's operator), one row."""
    n = out.size
    here, left, left2 = stiff[2 : 2 + n], stiff[1 : 1 + n], stiff[0:n]
    above, corner, other = stiff1[2 : 2 + n], stiff1[1 : 1 + n], stiff1[3 : 3 + n]
    above2, data, own, target = stiff2[2 : 2 + n], curvature[:n], total[:n], out[:n]
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for j in range(n):
        near = own[j] * here[j] + w0 * left[j] + w1 * above[j] + w2 * corner[j]
        target[j] = -1 / (data[j] + near + w3 * other[j] + w4 * left2[j] + w5 * above2[j])


@njit(fastmath=True)
def _turn(gradient, scale, step, data, direction, sums):  # type: ignore[no-untyped-def]
    """direction = scale · gradient, and its products, one row."""
    n = gradient.size
    g, by, d, f, z = gradient[:n], scale[:n], step[:n], data[:n], direction[:n]
    gz = gd = fz = fd = g.dtype.type(0)
    for j in range(n):
        new = g[j] * by[j]
        z[j] = new
        gz += g[j] * new
        gd += g[j] * d[j]
        fz += f[j] * new
        fd += f[j] * d[j]
    sums[2] += gz
    sums[3] += gd
    sums[4] += fz
    sums[5] += fd


@njit(parallel=True, cache=True)
def descend(  # type: ignore[no-untyped-def]
    x, slope, radius, epsilon, up, weights, curvature, data, step, stiffness, direction
):
    """Stiffness and preconditioned descent direction at a map.

    Args:
        x: (C, rows + 4, columns + 4), the map; slope: (C, 2, …) or (C, 2, 0, 0) = level; all padded by 2.
        radius: (…), r by pixel; epsilon: a number of x's type, ε.
        up: (3, 6, columns) and weights: (6,), the squared weights of the differences.
        curvature: (…), of the data term by pixel; data: (C, …), its gradient; step: (C, …), the last step.
        stiffness: (…), out; direction: (C, …), out.

    Returns:
        (6,) float64: Σ r ‖∇x − s‖, what smooth corners of width ε hide of it, and the products of the
        objective's gradient with direction and step, and of the data's gradient with direction and step.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    tiles = max(1, rows // _TILE_ROWS)
    sums = np.zeros((tiles, 6))
    tilted = slope.shape[2] > 0
    own, tilts = np.zeros((3, n), x.dtype), np.zeros((3, 2, n), x.dtype)
    for kind in range(3):
        for k in range(6):
            for j in range(n):
                own[kind, j] += up[kind, k, j]
                tilts[kind, 0, j] += ROWS[k] * up[kind, k, j]
                tilts[kind, 1, j] += COLUMNS[k] * up[kind, k, j]
    for tile in prange(tiles):
        top, end = tile * rows // tiles, (tile + 1) * rows // tiles
        ring, pulls = np.zeros((3, n + 4), x.dtype), np.zeros((3, channels, 2, n + 4), x.dtype)
        scratch = np.zeros((3, n), x.dtype)
        squares, scale, gradient = scratch[0], scratch[1], scratch[2]
        none = np.zeros(6)
        for row in range(max(0, top - 2), end):
            i, kind, now, last, before = (
                row + 2,
                max(0, row + 3 - rows),
                row % 3,
                (row + 2) % 3,
                (row + 1) % 3,
            )
            squares[:] = 0
            for c in range(channels):
                _add_squares(i, x[c], slope[c], up[kind], squares)
            out = sums[tile] if row >= top else none
            _stiffen(squares, radius[i, 2 : 2 + n], epsilon, ring[now, 2 : 2 + n], out)
            if row >= top:
                stiffness[i] = ring[now]
                _precondition(
                    ring[now], ring[last], ring[before], own[kind], weights, curvature[i, 2 : 2 + n], scale
                )
            for c in range(channels):
                gradient[:] = data[c, i, 2 : 2 + n]
                _forward(i, x[c], up[kind], ring[now], gradient)
                if tilted:
                    _tilt_forward(slope[c], i, tilts[kind], ring[now], pulls[now, c], gradient)
                if row >= top:
                    _backward(i, x[c], weights, ring[now], ring[last], ring[before], gradient)
                    if tilted:
                        _tilt_backward(pulls[now, c], pulls[last, c], pulls[before, c], weights, gradient)
                    _turn(
                        gradient,
                        scale,
                        step[c, i, 2 : 2 + n],
                        data[c, i, 2 : 2 + n],
                        direction[c, i, 2 : 2 + n],
                        out,
                    )
    return sums.sum(axis=0)


@njit(parallel=True, cache=True)
def norms(x, slope, up, out):  # type: ignore[no-untyped-def]
    """out (rows + 4, columns + 4) ← ‖∇x − slope‖₂ by pixel, all channels in one group."""
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    for row in prange(rows):
        squares = np.zeros(n, x.dtype)
        for c in range(channels):
            _add_squares(row + 2, x[c], slope[c], up[max(0, row + 3 - rows)], squares)
        out[row + 2, 2 : 2 + n] = np.sqrt(squares)


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
