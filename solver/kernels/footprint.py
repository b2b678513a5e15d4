"""The data term of area footprints: Σ Ω (y − A X)², with A X bilinear interpolation of the blurred map B X.

Every sample touches 2 × 2 nodes of B X, so Σ Aᵀ Ω A = Bᵀ M B with M a symmetric nine-point stencil, kept as
five coefficient images: the node itself, its neighbours to the right, below, below right and below left. Node
(0, 0) is the blur of the map's first taps × taps pixels. B has the same taps along rows and columns; they
are padded to a multiple of four with zeros, so that four are walked at a time.
"""

import numpy as np
from numba import njit, prange

_TILE_ROWS = 72
_BAND_ROWS = 32
"""Of M and b: few enough to stay in cache, many enough that few samples fall between two bands."""


@njit(fastmath=True)
def _blur_along(source, taps, out):  # type: ignore[no-untyped-def]
    """out[j] = Σ_k taps[k] source[j + k]; source is at least out.size + taps.size − 1 long."""
    n = out.size
    for k in range(0, taps.size, 4):
        h0, h1, h2, h3 = taps[k], taps[k + 1], taps[k + 2], taps[k + 3]
        s0, s1, s2, s3 = source[k : k + n], source[k + 1 :], source[k + 2 :], source[k + 3 :]
        if k == 0:
            for j in range(n):
                out[j] = h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]
        else:
            for j in range(n):
                out[j] += h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]


@njit(fastmath=True)
def _blur_across(source, first, step, taps, out):  # type: ignore[no-untyped-def]
    """out = Σ_k taps[k] source[first + step · k], whole rows."""
    n = out.size
    for k in range(0, taps.size, 4):
        h0, h1, h2, h3 = taps[k], taps[k + 1], taps[k + 2], taps[k + 3]
        r = first + step * k
        s0, s1, s2, s3 = source[r], source[r + step], source[r + 2 * step], source[r + 3 * step]
        if k == 0:
            for j in range(n):
                out[j] = h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]
        else:
            for j in range(n):
                out[j] += h0 * s0[j] + h1 * s1[j] + h2 * s2[j] + h3 * s3[j]


@njit(fastmath=True)
def _stencil_row(i, above, y, below, stencil, right_side, out):  # type: ignore[no-untyped-def]
    """out = (M y − b) at node row i; rows of y carry one zero on either side, the stencil one on the left."""
    n = out.size
    m0, mr, md = stencil[0, i + 1], stencil[1, i + 1], stencil[2, i + 1]
    ma, mb = stencil[3, i + 1], stencil[4, i + 1]
    ud, ua, ub = stencil[2, i], stencil[3, i], stencil[4, i]
    c0, cr, cd, ca, cb = m0[1 : 1 + n], mr[1 : 1 + n], md[1 : 1 + n], ma[1 : 1 + n], mb[1 : 1 + n]
    cl, du, dua, dub = mr[0:n], ud[1 : 1 + n], ua[0:n], ub[2 : 2 + n]
    yl, yc, yr = y[0:n], y[1 : 1 + n], y[2 : 2 + n]
    al, ac, ar = above[0:n], above[1 : 1 + n], above[2 : 2 + n]
    bl, bc, br = below[0:n], below[1 : 1 + n], below[2 : 2 + n]
    b = right_side[i + 1, 1 : 1 + n]
    for j in range(n):
        value = c0[j] * yc[j] + cr[j] * yr[j] + cl[j] * yl[j] - b[j]
        value += cd[j] * bc[j] + ca[j] * br[j] + cb[j] * bl[j]
        out[j] = value + du[j] * ac[j] + dua[j] * al[j] + dub[j] * ar[j]


@njit(parallel=True, fastmath=True, cache=True)
def gradient(x, stencil, right_side, taps, size, factor, out):  # type: ignore[no-untyped-def]
    """out ← factor · Bᵀ (M B x − b), one channel.

    Args:
        x, out: (rows + 4, columns + 4), padded by 2.
        stencil: (5, nodes + 2, nodes + 2), right_side: (nodes + 2, nodes + 2), padded by 1.
        taps: padded with zeros to a multiple of four; the first `size` of them count.
        factor: a number of x's type.
    """
    rows, columns = x.shape[0] - 4, x.shape[1] - 4
    node_rows, node_columns = rows - size + 1, columns - size + 1
    tiles = max(1, rows // _TILE_ROWS)
    padded = taps.size
    for tile in prange(tiles):
        top, end = tile * rows // tiles, (tile + 1) * rows // tiles
        # Rows of nodes whose transpose reaches this tile, one more either way for the stencil.
        first, last = max(0, top - size + 1), min(node_rows, end)
        low, high = max(0, first - 1), min(node_rows, last + 1)
        along = np.zeros((high - low + padded, node_columns), x.dtype)
        line = np.zeros(columns + padded, x.dtype)
        for r in range(low, high + size - 1):
            line[:columns] = x[r + 2, 2 : 2 + columns]
            _blur_along(line, taps, along[r - low])
        blurred = np.zeros((high - low + 2, node_columns + 2), x.dtype)
        for r in range(low, high):
            _blur_across(along, r - low, 1, taps, blurred[r - low + 1, 1 : 1 + node_columns])
        # residual[k] belongs to node row first − padded + 1 + k, zero where there is no such row.
        residual = np.zeros((last - first + 2 * padded, columns + 2 * padded), x.dtype)
        for r in range(first, last):
            _stencil_row(
                r,
                blurred[r - low],
                blurred[r - low + 1],
                blurred[r - low + 2],
                stencil,
                right_side,
                residual[r - first + padded - 1, size - 1 : size - 1 + node_columns],
            )
        across = np.zeros(columns + 2 * padded, x.dtype)
        for r in range(top, end):
            # Σ_k taps[k] residual(row r − k); symmetric taps let the columns run forward.
            start = r - first + padded - 1
            _blur_across(residual, start, -1, taps, across)
            target = out[r + 2, 2 : 2 + columns]
            _blur_along(across, taps, target)
            for j in range(columns):
                target[j] *= factor


@njit(parallel=True, cache=True)
def blur(x, taps, size, out):  # type: ignore[no-untyped-def]
    """out ← B x, one channel; out (nodes + 2, nodes + 2), padded by 1."""
    rows, columns = x.shape[0] - 4, x.shape[1] - 4
    node_rows, node_columns = rows - size + 1, columns - size + 1
    along = np.zeros((rows + taps.size, node_columns), x.dtype)
    for r in prange(rows):
        line = np.zeros(columns + taps.size, x.dtype)
        line[:columns] = x[r + 2, 2 : 2 + columns]
        _blur_along(line, taps, along[r])
    for r in prange(node_rows):
        _blur_across(along, r, 1, taps, out[r + 1, 1 : 1 + node_columns])


@njit(cache=True, inline="always")
def _corner(position, scale, offset, nodes):  # type: ignore[no-untyped-def]
    """(first node, fraction) under a sample; −1 where its footprint leaves the map."""
    at = (float(position) + 0.5) * scale + offset
    if not (0 <= at <= nodes - 1):  # also refuses NaN
        return -1, 0.0
    node = min(int(at), nodes - 2)
    return node, at - node


@njit(cache=True)
def _ranges(weights, positions, scale, offset, nodes, across):  # type: ignore[no-untyped-def]
    """(N, H, 2): the least and the largest first node row of each frame row's samples; (nodes, −1): none."""
    frames, rows, columns = weights.shape
    out = np.empty((frames, rows, 2), np.int64)
    for k in range(frames):
        for i in range(rows):
            low, high = np.inf, -np.inf
            for j in range(columns):
                if weights[k, i, j] > 0:
                    at = (float(positions[k, i, j, 0]) + 0.5) * scale + offset
                    beside = (float(positions[k, i, j, 1]) + 0.5) * scale + offset
                    if 0 <= at <= nodes - 1 and 0 <= beside <= across - 1:
                        low, high = min(low, at), max(high, at)
            out[k, i, 0] = min(int(low), nodes - 2) if low <= high else nodes
            out[k, i, 1] = min(int(high), nodes - 2) if low <= high else -1
    return out


@njit(parallel=True, cache=True)
def accumulate(values, weights, positions, scale, offset, stencil, right_side):  # type: ignore[no-untyped-def]
    """Add frames to M and b; whether any sample was used.

    Bands of node rows are filled one by one, which keeps them in cache and gives each band one writer.

    Args:
        values: (C, N, H, W); weights: (N, H, W), 0 = not used; positions: (N, H, W, 2).
        scale: β; offset: node of a footprint centred on coordinate 0 of the fused grid's edges.
        stencil: (5, …), right_side: (C, …).
    """
    channels, frames, rows, columns = values.shape
    node_rows, node_columns = stencil.shape[1] - 2, stencil.shape[2] - 2
    ranges = _ranges(weights, positions, scale, offset, node_rows, node_columns)
    bands = max(1, node_rows // _BAND_ROWS)
    for band in prange(bands):
        top, end = band * node_rows // bands, (band + 1) * node_rows // bands
        for k in range(frames):
            for i in range(rows):
                if ranges[k, i, 1] + 1 < top or ranges[k, i, 0] >= end:
                    continue
                for j in range(columns):
                    weight = weights[k, i, j]
                    if weight <= 0:
                        continue
                    u, fu = _corner(positions[k, i, j, 0], scale, offset, node_rows)
                    if u + 1 < top or u >= end:
                        continue
                    v, fv = _corner(positions[k, i, j, 1], scale, offset, node_columns)
                    if u < 0 or v < 0:
                        continue
                    a, b = (1 - fu) * (1 - fv), (1 - fu) * fv
                    c, d = fu * (1 - fv), fu * fv
                    r, s = u + 1, v + 1
                    if u >= top:
                        stencil[0, r, s] += weight * a * a
                        stencil[0, r, s + 1] += weight * b * b
                        stencil[1, r, s] += weight * a * b
                        stencil[2, r, s] += weight * a * c
                        stencil[2, r, s + 1] += weight * b * d
                        stencil[3, r, s] += weight * a * d
                        stencil[4, r, s + 1] += weight * b * c
                        for channel in range(channels):
                            value = weight * values[channel, k, i, j]
                            right_side[channel, r, s] += a * value
                            right_side[channel, r, s + 1] += b * value
                    if u + 1 < end:
                        stencil[0, r + 1, s] += weight * c * c
                        stencil[0, r + 1, s + 1] += weight * d * d
                        stencil[1, r + 1, s] += weight * c * d
                        for channel in range(channels):
                            value = weight * values[channel, k, i, j]
                            right_side[channel, r + 1, s] += c * value
                            right_side[channel, r + 1, s + 1] += d * value
    return ranges[..., 1].max() >= 0


@njit(parallel=True, cache=True)
def residuals(values, weights, positions, scale, offset, blurred):  # type: ignore[no-untyped-def]
    """(5,) sums over the samples in float64: Ω, Ω y, Ω A X, Ω (y − A X)², Ω (y² − (A X)²), of one channel.

    Args: values (N, H, W); blurred (nodes + 2, nodes + 2); the others as in `accumulate`.
    """
    frames, rows, columns = values.shape
    node_rows, node_columns = blurred.shape[0] - 2, blurred.shape[1] - 2
    sums = np.zeros((frames * rows, 5))
    for line in prange(frames * rows):
        k, i = line // rows, line % rows
        total, data, fit, square, rest = 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(columns):
            weight = float(weights[k, i, j])
            if weight <= 0:
                continue
            u, fu = _corner(positions[k, i, j, 0], scale, offset, node_rows)
            v, fv = _corner(positions[k, i, j, 1], scale, offset, node_columns)
            if u < 0 or v < 0:
                continue
            u, v = u + 1, v + 1
            y = float(values[k, i, j])
            upper = (1 - fv) * blurred[u, v] + fv * blurred[u, v + 1]
            lower = (1 - fv) * blurred[u + 1, v] + fv * blurred[u + 1, v + 1]
            model = (1 - fu) * upper + fu * lower
            total += weight
            data += weight * y
            fit += weight * model
            square += weight * (y - model) * (y - model)
            rest += weight * (y - model) * (y + model)
        sums[line, 0], sums[line, 1], sums[line, 2] = total, data, fit
        sums[line, 3], sums[line, 4] = square, rest
    return sums.sum(axis=0)
