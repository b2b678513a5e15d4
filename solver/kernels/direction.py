"""The preconditioned descent direction at a map, by rows; images are padded as in `kernels.prior`."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from solver.kernels.prior import (
    add_pull_backward,
    add_pull_forward,
    add_squares,
    add_tilt_backward,
    stiffen,
)


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


@njit(fastmath=True)
def _misfit(x, mean, curvature, out):  # type: ignore[no-untyped-def]
    """out = curvature · (x − mean), one row."""
    n = out.size
    a, b, c, target = x[:n], mean[:n], curvature[:n], out[:n]
    for j in range(n):
        target[j] = c[j] * (a[j] - b[j])


@njit
def descend(  # type: ignore[no-untyped-def]
    top,
    end,
    x,
    slope,
    radius,
    epsilon,
    up,
    weights,
    curvature,
    diagonal,
    data,
    step,
    stiffness,
    direction,
    sums,
):
    """Stiffness and preconditioned descent direction in rows top to end.

    Args:
        x: (C, rows + 4, columns + 4), the map; slope: (C, 2, …) or (C, 2, 0, 0) = level; all padded by 2.
        radius: (…), r by pixel; epsilon: a number of x's type, ε.
        up: (3, 6, columns) and weights: (8,), the squared weights of the differences, the last two doubled.
        curvature: (…), of the data term by pixel.
        data: (C, …), the data term's gradient; where its operator is diagonal, the map that it draws to.
        step: (C, …), the last step; stiffness: (…), out; direction: (C, …), out.
        sums: (rows, 6), out, by row: Σ r ‖∇x − s‖, what smooth corners of width ε hide of it, and the
            products of the objective's gradient with direction and step, and of the data's with both.
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    tilted = slope.shape[2] > 0
    own = np.zeros((3, n), x.dtype)
    for kind in range(3):
        for k in range(6):
            for j in range(n):
                own[kind, j] += up[kind, k, j]
    ring, pulls = np.zeros((3, n + 4), x.dtype), np.zeros((3, channels, 2, n + 4), x.dtype)
    scratch = np.zeros((4, n), x.dtype)
    squares, scale, gradient, pull = scratch[0], scratch[1], scratch[2], scratch[3]
    none = np.zeros(6)
    for row in range(max(0, top - 2), end):
        i, kind, now, last, before = row + 2, max(0, row + 3 - rows), row % 3, (row + 2) % 3, (row + 1) % 3
        counts = row >= top
        squares[:] = 0
        for c in range(channels):
            add_squares(i, x[c], slope[c], up[kind], squares)
        out = sums[row] if counts else none
        out[:] = 0
        stiffen(squares, radius[i, 2 : 2 + n], epsilon, ring[now, 2 : 2 + n], out)
        if counts:
            stiffness[i] = ring[now]
            _precondition(
                ring[now], ring[last], ring[before], own[kind], weights, curvature[i, 2 : 2 + n], scale
            )
        for c in range(channels):
            if counts:
                if diagonal:
                    _misfit(x[c, i, 2 : 2 + n], data[c, i, 2 : 2 + n], curvature[i, 2 : 2 + n], pull)
                else:
                    pull[:] = data[c, i, 2 : 2 + n]
                gradient[:] = pull
            add_pull_forward(i, x[c], slope[c], up[kind], ring[now], pulls[now, c], gradient)
            if counts:
                add_pull_backward(i, x[c], weights, ring[now], ring[last], ring[before], gradient)
                if tilted:
                    add_tilt_backward(pulls[now, c], pulls[last, c], pulls[before, c], weights, gradient)
                _turn(gradient, scale, step[c, i, 2 : 2 + n], pull, direction[c, i, 2 : 2 + n], out)


def doubled(weights: NDArray[np.floating]) -> NDArray[np.floating]:
    """(8,): the squared weights (6,), and those of the two-pixel differences twice."""
    return np.concatenate([weights, weights[4:] + weights[4:]])
