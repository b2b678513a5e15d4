"""One primal–dual iteration of the group prior, and its value.

The dual variables of the six differences of a pixel are one group. `up` holds the differences' weights times
the dual step by column, 0 where a difference leaves the image: one table for ordinary rows, one for the last
row but one and one for the last.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

PAD = 2
"""The widest difference spans two pixels."""

_ROWS, _COLUMNS = (0, 1, 1, 1, 0, 2), (1, 0, 1, -1, 2, 0)
"""The differences' offsets."""

_TILE_ROWS = 36
"""Rows walked together: two tiles of 704 columns, eight arrays each, fit the cache of one core."""


@njit(fastmath=True)
def _ascend(i, over, dual, up, rho):  # type: ignore[no-untyped-def]
    """dual ← dual + ρ (projection of (dual + σ ∇over) onto the unit ball − dual), row i, one channel."""
    n = over.shape[1] - 4
    here, right, right2 = over[i, 2 : 2 + n], over[i, 3 : 3 + n], over[i, 4 : 4 + n]
    down, diagonal, antidiagonal = over[i + 1, 2 : 2 + n], over[i + 1, 3 : 3 + n], over[i + 1, 1 : 1 + n]
    down2 = over[i + 2, 2 : 2 + n]
    p0, p1, p2 = dual[0, i, 2 : 2 + n], dual[1, i, 2 : 2 + n], dual[2, i, 2 : 2 + n]
    p3, p4, p5 = dual[3, i, 2 : 2 + n], dual[4, i, 2 : 2 + n], dual[5, i, 2 : 2 + n]
    # Differences down leave the image by whole rows, so their weights are the same in every column. Fewer
    # arrays also keep the compiler's test that none overlap within its limit.
    w0, w1, w2, w3, w4, w5 = up[0], up[1, 0], up[2], up[3], up[4], up[5, 0]
    keep = over.dtype.type(1) - rho  # a plain 1 would make it float64
    for j in range(n):
        x = here[j]
        o0, o1, o2, o3, o4, o5 = p0[j], p1[j], p2[j], p3[j], p4[j], p5[j]
        a0 = o0 + w0[j] * (x - right[j])
        a1 = o1 + w1 * (x - down[j])
        a2 = o2 + w2[j] * (x - diagonal[j])
        a3 = o3 + w3[j] * (x - antidiagonal[j])
        a4 = o4 + w4[j] * (x - right2[j])
        a5 = o5 + w5 * (x - down2[j])
        square = a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3 + a4 * a4 + a5 * a5
        s = rho / np.sqrt(max(np.float32(1), square))
        p0[j] = keep * o0 + s * a0
        p1[j] = keep * o1 + s * a1
        p2[j] = keep * o2 + s * a2
        p3[j] = keep * o3 + s * a3
        p4[j] = keep * o4 + s * a4
        p5[j] = keep * o5 + s * a5


@njit(fastmath=True)
def _squares(i, over, dual, up, squares):  # type: ignore[no-untyped-def]
    """Add one channel's ‖dual + σ ∇over‖² at row i: half of `_ascend`, for channels and balls of any size."""
    n = over.shape[1] - 4
    here, right, right2 = over[i, 2 : 2 + n], over[i, 3 : 3 + n], over[i, 4 : 4 + n]
    down, diagonal, antidiagonal = over[i + 1, 2 : 2 + n], over[i + 1, 3 : 3 + n], over[i + 1, 1 : 1 + n]
    down2 = over[i + 2, 2 : 2 + n]
    p0, p1, p2 = dual[0, i, 2 : 2 + n], dual[1, i, 2 : 2 + n], dual[2, i, 2 : 2 + n]
    p3, p4, p5 = dual[3, i, 2 : 2 + n], dual[4, i, 2 : 2 + n], dual[5, i, 2 : 2 + n]
    w0, w1, w2, w3, w4, w5 = up[0], up[1, 0], up[2], up[3], up[4], up[5, 0]
    for j in range(n):
        x = here[j]
        a0 = p0[j] + w0[j] * (x - right[j])
        a1 = p1[j] + w1 * (x - down[j])
        a2 = p2[j] + w2[j] * (x - diagonal[j])
        a3 = p3[j] + w3[j] * (x - antidiagonal[j])
        a4 = p4[j] + w4[j] * (x - right2[j])
        a5 = p5[j] + w5 * (x - down2[j])
        squares[j] += a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3 + a4 * a4 + a5 * a5


@njit(fastmath=True)
def _scale(i, over, dual, up, factor, rho):  # type: ignore[no-untyped-def]
    """The second half: dual ← (1 − ρ) dual + factor · (dual + σ ∇over), row i, one channel."""
    n = over.shape[1] - 4
    here, right, right2 = over[i, 2 : 2 + n], over[i, 3 : 3 + n], over[i, 4 : 4 + n]
    down, diagonal, antidiagonal = over[i + 1, 2 : 2 + n], over[i + 1, 3 : 3 + n], over[i + 1, 1 : 1 + n]
    down2 = over[i + 2, 2 : 2 + n]
    p0, p1, p2 = dual[0, i, 2 : 2 + n], dual[1, i, 2 : 2 + n], dual[2, i, 2 : 2 + n]
    p3, p4, p5 = dual[3, i, 2 : 2 + n], dual[4, i, 2 : 2 + n], dual[5, i, 2 : 2 + n]
    w0, w1, w2, w3, w4, w5 = up[0], up[1, 0], up[2], up[3], up[4], up[5, 0]
    keep = over.dtype.type(1) - rho  # a plain 1 would make it float64
    for j in range(n):
        x, s = here[j], factor[j]
        t = keep + s
        p0[j] = t * p0[j] + s * w0[j] * (x - right[j])
        p1[j] = t * p1[j] + s * w1 * (x - down[j])
        p2[j] = t * p2[j] + s * w2[j] * (x - diagonal[j])
        p3[j] = t * p3[j] + s * w3[j] * (x - antidiagonal[j])
        p4[j] = t * p4[j] + s * w4[j] * (x - right2[j])
        p5[j] = t * p5[j] + s * w5 * (x - down2[j])


@njit(fastmath=True)
def _tilt(i, dual, up, slope, amount):  # type: ignore[no-untyped-def]
    """dual ← dual + amount · σ · (the differences that the slope foretells), row i, one channel.

    A loop by difference: all six arrays at once would be more than the compiler proves free of overlap.
    """
    n = slope.shape[2] - 4
    down, right = slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n]
    for k in range(6):
        rows, columns = amount * _ROWS[k], amount * _COLUMNS[k]
        p, w = dual[k, i, 2 : 2 + n], up[k]
        for j in range(n):
            p[j] += w[j] * (rows * down[j] + columns * right[j])


@njit(fastmath=True)
def _descend(i, x, over, dual, down, shrink, pull, rho):  # type: ignore[no-untyped-def]
    """x̂ = (x − τ ∇ᵀdual) · shrink + pull; over ← 2 x̂ − x; x ← x + ρ (x̂ − x), row i, one channel."""
    n = over.shape[1] - 4
    a0, b0 = dual[0, i, 2 : 2 + n], dual[0, i, 1 : 1 + n]
    a1, b1 = dual[1, i, 2 : 2 + n], dual[1, i - 1, 2 : 2 + n]
    a2, b2 = dual[2, i, 2 : 2 + n], dual[2, i - 1, 1 : 1 + n]
    a3, b3 = dual[3, i, 2 : 2 + n], dual[3, i - 1, 3 : 3 + n]
    a4, b4 = dual[4, i, 2 : 2 + n], dual[4, i, 0:n]
    a5, b5 = dual[5, i, 2 : 2 + n], dual[5, i - 2, 2 : 2 + n]
    here, ahead, by, toward = x[i, 2 : 2 + n], over[i, 2 : 2 + n], shrink[i, 2 : 2 + n], pull[i, 2 : 2 + n]
    w0, w1, w2, w3, w4, w5 = down[0], down[1], down[2], down[3], down[4], down[5]
    for j in range(n):
        slope = w0 * (a0[j] - b0[j]) + w1 * (a1[j] - b1[j]) + w2 * (a2[j] - b2[j])
        slope += w3 * (a3[j] - b3[j]) + w4 * (a4[j] - b4[j]) + w5 * (a5[j] - b5[j])
        old = here[j]
        new = (old - slope) * by[j] + toward[j]
        ahead[j] = new + new - old
        here[j] = old + rho * (new - old)


@njit(fastmath=True)
def _sweep(  # type: ignore[no-untyped-def]
    ascend, descend, x, over, dual, weighted, radius, slope, shrink, pull, up, down, rho
):
    """One iteration over some rows: a row of the map moves once all groups that see it have moved."""
    channels, rows = x.shape[0], x.shape[1] - 4
    factor = np.empty(x.shape[2] - 4, x.dtype)
    one = x.dtype.type(1)
    tilted = slope.shape[2] > 0
    for row in range(min(ascend[0], descend[0]), max(ascend[1], descend[1])):
        i = row + PAD
        if ascend[0] <= row < ascend[1]:
            weights = up[max(0, row + 3 - rows)]
            if channels == 1 and not weighted:
                _ascend(i, over[0], dual[0], weights, rho)
            else:
                factor[:] = 0
                for c in range(channels):
                    if tilted:
                        _tilt(i, dual[c], weights, slope[c], one)
                    _squares(i, over[c], dual[c], weights, factor)
                reach = radius[i, 2 : 2 + factor.size]
                for j in range(factor.size):
                    factor[j] = rho * reach[j] / np.sqrt(max(reach[j] * reach[j], factor[j]))
                for c in range(channels):
                    _scale(i, over[c], dual[c], weights, factor, rho)
                    if tilted:  # _scale kept 1 − ρ of the tilt too
                        _tilt(i, dual[c], weights, slope[c], rho - one)
        if descend[0] <= row < descend[1]:
            for c in range(channels):
                _descend(i, x[c], over[c], dual[c], down, shrink, pull[c], rho)


@njit(parallel=True, fastmath=True, cache=True)
def iterate(  # type: ignore[no-untyped-def]
    iterations, x, over, dual, weighted, radius, slope, shrink, pull, up, down, rho
):
    """Run iterations in place: tiles of rows side by side, then the two rows either side of each seam.

    Args:
        iterations: how many, with the same `shrink` and `pull`.
        x, over: (C, rows, columns), padded; the map and its extrapolation.
        dual: (C, 6, rows, columns), padded.
        weighted: whether the groups' balls have other radii than 1; radius: (rows, columns), padded.
        slope: (C, 2, rows, columns), padded: the fall per row and per column that costs nothing, or
            (C, 2, 0, 0) = level; a slope counts as weighted.
        shrink: (rows, columns), padded; pull: (C, rows, columns), padded: the data term's step.
        up: (3, 6, columns) and down: (6,), the differences' weights times the dual and the primal step.
        rho: over-relaxation, from 1 up to below 2.
    """
    rows = x.shape[1] - 4
    tiles = max(1, rows // _TILE_ROWS)
    for _ in range(iterations):
        for phase in range(2):
            for tile in prange(tiles - phase):
                top, end = tile * rows // tiles, (tile + 1) * rows // tiles
                if phase == 0:
                    last = rows if tile == tiles - 1 else end - PAD
                    ascend = (top, last)
                    descend = (0 if tile == 0 else top + PAD, last)
                else:
                    ascend = (end - PAD, end)
                    descend = (end - PAD, end + PAD)
                _sweep(ascend, descend, x, over, dual, weighted, radius, slope, shrink, pull, up, down, rho)


@njit(fastmath=True)
def _gradient_squares(row, x, up, slope, square):  # type: ignore[no-untyped-def]
    """Add ‖∇x − what the slope foretells‖² of a row, all channels."""
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    weights = up[max(0, row + 3 - rows)]
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1, 0], weights[2], weights[3], weights[4], weights[5, 0]
    level = np.zeros(n, x.dtype)
    for c in range(channels):
        falls, runs = level, level
        if slope.shape[2] > 0:
            falls, runs = slope[c, 0, row + 2, 2 : 2 + n], slope[c, 1, row + 2, 2 : 2 + n]
        a, b, d = x[c, row + 2], x[c, row + 3], x[c, row + 4]
        here, right, right2 = a[2 : 2 + n], a[3 : 3 + n], a[4 : 4 + n]
        down, diagonal, antidiagonal, down2 = b[2 : 2 + n], b[3 : 3 + n], b[1 : 1 + n], d[2 : 2 + n]
        for j in range(n):
            v, s, r = here[j], falls[j], runs[j]
            g0, g1 = w0[j] * (v - right[j] + r), w1 * (v - down[j] + s)
            g2, g3 = w2[j] * (v - diagonal[j] + s + r), w3[j] * (v - antidiagonal[j] + s - r)
            g4, g5 = w4[j] * (v - right2[j] + r + r), w5 * (v - down2[j] + s + s)
            square[j] += g0 * g0 + g1 * g1 + g2 * g2 + g3 * g3 + g4 * g4 + g5 * g5


@njit(parallel=True, fastmath=True, cache=True)
def total(x, radius, slope, up):  # type: ignore[no-untyped-def]
    """Σ radius ‖∇x − slope‖₂ over pixels, all channels in one group; `up` made for a dual step of 1."""
    rows = x.shape[1] - 4
    sums = np.zeros(rows)
    for row in prange(rows):
        n = x.shape[2] - 4
        square = np.zeros(n, x.dtype)
        _gradient_squares(row, x, up, slope, square)
        value, reach = 0.0, radius[row + 2, 2 : 2 + n]
        for j in range(n):
            value += reach[j] * np.sqrt(square[j])
        sums[row] = value
    return sums.sum()


@njit(parallel=True, fastmath=True, cache=True)
def norms(x, slope, up, out):  # type: ignore[no-untyped-def]
    """out (rows + 4, columns + 4) ← ‖∇x − slope‖₂ by pixel; `up` made for a dual step of 1."""
    rows = x.shape[1] - 4
    for row in prange(rows):
        n = x.shape[2] - 4
        square = np.zeros(n, x.dtype)
        _gradient_squares(row, x, up, slope, square)
        target = out[row + 2, 2 : 2 + n]
        for j in range(n):
            target[j] = np.sqrt(square[j])


@njit(parallel=True, fastmath=True, cache=True)
def project(dual, radius):  # type: ignore[no-untyped-def]
    """Bring every group of dual (C, 6, rows, columns) into its ball, which over-relaxation may leave."""
    channels, rows, columns = dual.shape[0], dual.shape[2], dual.shape[3]
    for i in prange(rows):
        square = np.zeros(columns, dual.dtype)
        for c in range(channels):
            for k in range(6):
                row = dual[c, k, i]
                for j in range(columns):
                    square[j] += row[j] * row[j]
        reach = radius[i]
        for j in range(columns):
            square[j] = reach[j] / np.sqrt(max(reach[j] * reach[j], square[j], np.float32(1e-30)))
        for c in range(channels):
            for k in range(6):
                row = dual[c, k, i]
                for j in range(columns):
                    row[j] *= square[j]


@njit(parallel=True, fastmath=True, cache=True)
def transpose(dual, weights, out):  # type: ignore[no-untyped-def]
    """out (rows, columns) ← ∇ᵀ dual, one channel (6, rows + 4, columns + 4), in out's precision."""
    rows, n = out.shape
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for row in prange(rows):
        i = row + 2
        a0, b0 = dual[0, i, 2 : 2 + n], dual[0, i, 1 : 1 + n]
        a1, b1 = dual[1, i, 2 : 2 + n], dual[1, i - 1, 2 : 2 + n]
        a2, b2 = dual[2, i, 2 : 2 + n], dual[2, i - 1, 1 : 1 + n]
        a3, b3 = dual[3, i, 2 : 2 + n], dual[3, i - 1, 3 : 3 + n]
        a4, b4 = dual[4, i, 2 : 2 + n], dual[4, i, 0:n]
        a5, b5 = dual[5, i, 2 : 2 + n], dual[5, i - 2, 2 : 2 + n]
        for j in range(n):
            slope = w0 * (float(a0[j]) - b0[j]) + w1 * (float(a1[j]) - b1[j])
            slope += w2 * (float(a2[j]) - b2[j]) + w3 * (float(a3[j]) - b3[j])
            out[row, j] = slope + w4 * (float(a4[j]) - b4[j]) + w5 * (float(a5[j]) - b5[j])


def tables(weights: NDArray[np.floating], columns: int, step: float) -> NDArray[np.floating]:
    """`up` for an image of this many columns: the weights (6,) times the step, 0 where they leave it."""
    up = np.empty((3, 6, columns), weights.dtype)
    up[:] = (weights * weights.dtype.type(step))[:, None]
    up[:, [0, 2], columns - 1 :] = 0
    up[:, 3, :1] = 0
    up[:, 4, max(0, columns - 2) :] = 0
    up[1:, 5] = 0
    up[2, 1:4] = 0
    return up
