"""The preconditioned descent direction at a map, row by row; images are padded as in `kernels.group`.

The direction is −gradient / (curvature of the data + diagonal of the majorant's operator), elementwise.
"""

import numpy as np
from numba import njit

from solver.kernels.group import add_squares, inside, stiffen, weights_at
from solver.kernels.view import view

_IN_ORDER = {"contract", "nnan", "ninf", "nsz"}
"""Free to reorder, the compiler makes one chain of a sum, in which each addition waits for the one before."""


@njit(fastmath=_IN_ORDER)
def _three(a, x, b, y, c, z):  # type: ignore[no-untyped-def]
    return a * x + b * y + c * z


@njit(fastmath=_IN_ORDER)
def _two(a, b):  # type: ignore[no-untyped-def]
    return a + b


@njit(fastmath=_IN_ORDER)
def _sum(own, slack, forward, backward):  # type: ignore[no-untyped-def]
    return (own + slack * forward) + backward


@njit(fastmath=True)
def _misfit(x, mean, curvature, out):  # type: ignore[no-untyped-def]
    """out = curvature · (x − mean), one row."""
    for j in range(out.size):
        out[j] = curvature[j] * (x[j] - mean[j])


@njit(fastmath=True, error_model="numpy")
def _turn(c, i, x, slope, own, before, ring, places, inside, rows, sums):  # type: ignore[no-untyped-def]
    """Channel c of row i ← the direction; add its products.

    Args:
        own: weights of the pixel's own differences; before: of those of the pixels before it.
        ring, places: stiffness, and where rows i, i − 1, i − 2 are.
        rows: curvature, the data's gradient, step and direction (out) of this row.
    """
    curvature, data, step, direction = rows
    m, a, at, next1, next2, last1, last2 = (
        data.size,
        2,
        (c, i),
        (c, i + 1),
        (c, i + 2),
        (c, i - 1),
        (c, i - 2),
    )
    one, two, back = view(inside, (), a + 1, m), view(inside, (), a + 2, m), view(inside, (), a - 1, m)
    here, right, right2 = view(x, at, a, m), view(x, at, a + 1, m), view(x, at, a + 2, m)
    down, diagonal = view(x, next1, a, m), view(x, next1, a + 1, m)
    antidiagonal, down2 = view(x, next1, a - 1, m), view(x, next2, a, m)
    left, left2, above = view(x, at, a - 1, m), view(x, at, a - 2, m), view(x, last1, a, m)
    corner, other, above2 = view(x, last1, a - 1, m), view(x, last1, a + 1, m), view(x, last2, a, m)
    now, up1, up2 = (places[0],), (places[1],), (places[2],)
    slack, s0, s4 = view(ring, now, a, m), view(ring, now, a - 1, m), view(ring, now, a - 2, m)
    s1, s2, s3 = view(ring, up1, a, m), view(ring, up1, a - 1, m), view(ring, up1, a + 1, m)
    s5 = view(ring, up2, a, m)
    whole0, w1, whole2, whole3, whole4, w5 = own
    b0, b1, b2, b3, b4, b5 = before[0], before[1], before[2], before[3], before[4], before[5]
    down_weights, fall_weights = w1 + w5, w1 + w5 + w5
    gz = gd = fz = fd = x.dtype.type(0)
    if slope.shape[2] > 0:
        fall, run = view(slope, (c, 0, i), a, m), view(slope, (c, 1, i), a, m)
        run0, run4 = view(slope, (c, 1, i), a - 1, m), view(slope, (c, 1, i), a - 2, m)
        fall1, fall2 = view(slope, (c, 0, i - 1), a, m), view(slope, (c, 0, i - 1), a - 1, m)
        fall3, fall5 = view(slope, (c, 0, i - 1), a + 1, m), view(slope, (c, 0, i - 2), a, m)
        run2, run3 = view(slope, (c, 1, i - 1), a - 1, m), view(slope, (c, 1, i - 1), a + 1, m)
        for j in range(m):
            v = here[j]
            w0, w2, w3, w4 = whole0 * one[j], whole2 * one[j], whole3 * back[j], whole4 * two[j]
            p0, p1, p2, p3, p4, p5 = b0 * s0[j], b1 * s1[j], b2 * s2[j], b3 * s3[j], b4 * s4[j], b5 * s5[j]
            near = (
                _three(w0, v - right[j], w1, v - down[j], w2, v - diagonal[j])
                + (fall_weights + w2 + w3) * fall[j]
            )
            far = (
                _three(w3, v - antidiagonal[j], w4, v - right2[j], w5, v - down2[j])
                + (w0 + w2 - w3 + w4 + w4) * run[j]
            )
            v0, v1, v2 = v - left[j] - run0[j], v - above[j] - fall1[j], v - corner[j] - fall2[j] - run2[j]
            v3, v4 = v - other[j] - fall3[j] + run3[j], v - left2[j] - run4[j] - run4[j]
            before1 = _three(p0, v0, p1, v1, p2, v2)
            before2 = _three(p3, v3, p4, v4, p5, v - above2[j] - fall5[j] - fall5[j])
            gradient = _sum(data[j], slack[j], _two(near, far), _two(before1, before2))
            whole = down_weights + w0 + w2 + w3 + w4
            new = -gradient / (curvature[j] + whole * slack[j] + p0 + p1 + p2 + p3 + p4 + p5)
            direction[j] = new
            gz += gradient * new
            gd += gradient * step[j]
            fz += data[j] * new
            fd += data[j] * step[j]
    else:
        for j in range(m):
            v = here[j]
            w0, w2, w3, w4 = whole0 * one[j], whole2 * one[j], whole3 * back[j], whole4 * two[j]
            p0, p1, p2, p3, p4, p5 = b0 * s0[j], b1 * s1[j], b2 * s2[j], b3 * s3[j], b4 * s4[j], b5 * s5[j]
            near = _three(w0, v - right[j], w1, v - down[j], w2, v - diagonal[j])
            far = _three(w3, v - antidiagonal[j], w4, v - right2[j], w5, v - down2[j])
            before1 = _three(p0, v - left[j], p1, v - above[j], p2, v - corner[j])
            before2 = _three(p3, v - other[j], p4, v - left2[j], p5, v - above2[j])
            gradient = _sum(data[j], slack[j], _two(near, far), _two(before1, before2))
            whole = down_weights + w0 + w2 + w3 + w4
            new = -gradient / (curvature[j] + whole * slack[j] + p0 + p1 + p2 + p3 + p4 + p5)
            direction[j] = new
            gz += gradient * new
            gd += gradient * step[j]
            fz += data[j] * new
            fd += data[j] * step[j]
    sums[2] += gz
    sums[3] += gd
    sums[4] += fz
    sums[5] += fd


@njit
def scratch(n, depth, kind):  # type: ignore[no-untyped-def]
    """What `descend` keeps: the stiffness of the last `depth` rows, two lines, and `prior.inside`."""
    return np.zeros((depth, n + 4), kind), np.zeros((2, n), kind), inside(n, kind)


@njit
def descend(  # type: ignore[no-untyped-def]
    first, end, top, x, slope, radius, epsilon, weights, curvature, diagonal, data, step, kept, direction,
    sums
):  # fmt: skip
    """Stiffness and preconditioned descent direction of rows first to end; the two before must be done.

    Args:
        top: the first row of which the direction is wanted, not the stiffness alone.
        x: (C, rows + 4, columns + 4), the map; slope: (C, 2, …) or (C, 2, 0, 0) = level; all padded by 2.
        radius: (…), r by pixel; epsilon: a number of x's type, ε.
        weights: (6,), the squared weights of the differences.
        curvature: (…), of the data term by pixel.
        data: (C, …), the data term's gradient; where its operator is diagonal, the map that it draws to.
        step: (C, …), the last step; kept: `scratch`; direction: (C, …), out.
        sums: (rows, at least 6), out by row: Σ r ‖∇x − s‖, what smooth corners of width ε hide of it, and the
            products of the objective's gradient with direction and step, and of the data's with both.
    """
    channels, rows, n, none = x.shape[0], x.shape[1] - 4, x.shape[2] - 4, np.zeros(6)
    ring, lines, within = kept
    depth, squares = ring.shape[0], view(lines, (0,), 0, n)
    for row in range(first, end):
        i, own, out = row + 2, weights_at(row, rows, weights), view(none, (), 0, 6)
        places = (row % depth, (row - 1) % depth, (row - 2) % depth)
        if row >= top:
            out = view(sums, (row,), 0, 6)
        for k in range(6):
            out[k] = 0
        for j in range(n):
            squares[j] = 0
        for c in range(channels):
            add_squares(c, i, x, slope, own, within, squares)
        stiffen(squares, view(radius, (i,), 2, n), epsilon, view(ring, (places[0],), 2, n), out)
        if row < top:
            continue
        bent = view(curvature, (i,), 2, n)
        for c in range(channels):
            at, pull = (c, i), view(data, (c, i), 2, n)
            if diagonal:
                misfit = view(lines, (1,), 0, n)
                _misfit(view(x, at, 2, n), pull, bent, misfit)
                pull = misfit
            line = (bent, pull, view(step, at, 2, n), view(direction, at, 2, n))
            _turn(c, i, x, slope, own, weights, ring, places, within, line, out)
