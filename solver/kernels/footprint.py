"""The data term of area footprints: Σ Ω (y − A X)², with A X bilinear interpolation of the blurred map B X.

Every sample touches 2 × 2 nodes of B X, so Σ Aᵀ Ω A = Bᵀ M B with M a symmetric nine-point stencil, kept as
five coefficient images: the node itself, its neighbours to the right, below, below right and below left. Node
(0, 0) is the blur of the map's first taps × taps pixels.
"""

import numpy as np
from numba import njit

_BAND_ROWS = 32
"""Of M and b: few enough to stay in cache, many enough that few samples fall between two bands."""


@njit(cache=True, inline="always")
def _corner(position, scale, offset, nodes):  # type: ignore[no-untyped-def]
    """(first node, fraction) under a sample; −1 where its footprint leaves the map."""
    at = (float(position) + 0.5) * scale + offset
    if not (0 <= at <= nodes - 1):  # also refuses NaN
        return -1, 0.0
    node = min(int(at), nodes - 2)
    return node, at - node


@njit(cache=True)
def ranges(weights, positions, scale, offset, nodes, across):  # type: ignore[no-untyped-def]
    """(N, H, 2): the least and the largest first node row of each frame row's samples; (nodes, −1): none."""
    frames, rows, columns = weights.shape
    out = np.empty((frames, rows, 2), np.int64)
    for k in range(frames):
        for i in range(rows):
            low, high = np.inf, -np.inf
            for j in range(columns):
                if weights[k, i, j] != 0:
                    at = (float(positions[k, i, j, 0]) + 0.5) * scale + offset
                    beside = (float(positions[k, i, j, 1]) + 0.5) * scale + offset
                    if 0 <= at <= nodes - 1 and 0 <= beside <= across - 1:
                        low, high = min(low, at), max(high, at)
            out[k, i, 0] = min(int(low), nodes - 2) if low <= high else nodes
            out[k, i, 1] = min(int(high), nodes - 2) if low <= high else -1
    return out


@njit(nogil=True, cache=True)
def accumulate(  # type: ignore[no-untyped-def]
    rank, size, values, weights, positions, scale, offset, spans, stencil, right_side
):
    """Add frames to M and b.

    Bands of node rows are filled one by one, which keeps them in cache and gives each band one writer.

    Args:
        values: (C, N, H, W); weights: (N, H, W), 0 = not used, negative takes a frame away again; positions:
            (N, H, W, 2).
        scale: β; offset: node of a footprint centred on coordinate 0 of the fused grid's edges.
        spans: their `ranges`; stencil: (5, …), right_side: (C, …).
    """
    channels, frames, rows, columns = values.shape
    node_rows, node_columns = stencil.shape[1] - 2, stencil.shape[2] - 2
    bands = max(1, node_rows // _BAND_ROWS)
    for band in range(rank * bands // size, (rank + 1) * bands // size):
        top, end = band * node_rows // bands, (band + 1) * node_rows // bands
        for k in range(frames):
            for i in range(rows):
                if spans[k, i, 1] + 1 < top or spans[k, i, 0] >= end:
                    continue
                for j in range(columns):
                    weight = weights[k, i, j]
                    if weight == 0:
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


@njit(nogil=True, cache=True)
def residuals(rank, size, values, weights, positions, scale, offset, blurred, sums):  # type: ignore[no-untyped-def]
    """sums (N · H, C, 5) ← Ω, Ω y, Ω A X, Ω (y − A X)², Ω (y² − (A X)²) by row and channel, in float64.

    Args: values (C, N, H, W); blurred (C, nodes + 2, nodes + 2); the others as in `accumulate`.
    """
    channels, frames, rows, columns = values.shape
    node_rows, node_columns = blurred.shape[1] - 2, blurred.shape[2] - 2
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        for j in range(columns):
            weight = float(weights[k, i, j])
            if weight <= 0:
                continue
            u, fu = _corner(positions[k, i, j, 0], scale, offset, node_rows)
            v, fv = _corner(positions[k, i, j, 1], scale, offset, node_columns)
            if u < 0 or v < 0:
                continue
            u, v = u + 1, v + 1
            for c in range(channels):
                y, out = float(values[c, k, i, j]), sums[line, c]
                upper = (1 - fv) * blurred[c, u, v] + fv * blurred[c, u, v + 1]
                lower = (1 - fv) * blurred[c, u + 1, v] + fv * blurred[c, u + 1, v + 1]
                model = (1 - fu) * upper + fu * lower
                out[0] += weight
                out[1] += weight * y
                out[2] += weight * model
                out[3] += weight * (y - model) * (y - model)
                out[4] += weight * (y - model) * (y + model)
