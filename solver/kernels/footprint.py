"""The data term of area footprints: Σ Ω (y − A X)², with A X bilinear interpolation of the blurred map B X.

Every sample touches 2 × 2 nodes of B X, so Σ Aᵀ Ω A = Bᵀ M B with M a symmetric nine-point stencil, kept as
five coefficient images: the node itself, its neighbours to the right, below, below right and below left. Node
(0, 0) is the blur of the map's first taps × taps pixels.
"""

import numpy as np
from numba import njit, prange

@njit(cache=True, inline="always")
def _corner(position, scale, offset, nodes):  # type: ignore[no-untyped-def]
    """(first node, fraction) under a sample; −1 where its footprint leaves the map."""
    at = (float(position) + 0.5) * scale + offset
    if not (0 <= at <= nodes - 1):  # also refuses NaN
        return -1, 0.0
    node = min(int(at), nodes - 2)
    return node, at - node


@njit(parallel=True, cache=True)
def accumulate(  # type: ignore[no-untyped-def]
    values, weights, positions, scale, offset, stencil, right_side, count
):
    """Add frames to M and b.

    Args:
        values: (C, N, H, W); weights: (N, H, W), 0 = not used; positions: (N, H, W, 2).
        scale: β; offset: node of a footprint centred on coordinate 0 of the fused grid's edges.
        stencil: (G, 5, …), right_side: (G, C, …), count: (G,): G partial sums, which the caller adds up.
    """
    groups = stencil.shape[0]
    channels, frames, rows, columns = values.shape
    node_rows, node_columns = stencil.shape[2] - 2, stencil.shape[3] - 2
    for g in prange(groups):
        m = stencil[g]
        for k in range(g * frames // groups, (g + 1) * frames // groups):
            for i in range(rows):
                for j in range(columns):
                    weight = weights[k, i, j]
                    if weight <= 0:
                        continue
                    u, fu = _corner(positions[k, i, j, 0], scale, offset, node_rows)
                    v, fv = _corner(positions[k, i, j, 1], scale, offset, node_columns)
                    if u < 0 or v < 0:
                        continue
                    a, b = (1 - fu) * (1 - fv), (1 - fu) * fv
                    c, d = fu * (1 - fv), fu * fv
                    u, v = u + 1, v + 1
                    m[0, u, v] += weight * a * a
                    m[0, u, v + 1] += weight * b * b
                    m[0, u + 1, v] += weight * c * c
                    m[0, u + 1, v + 1] += weight * d * d
                    m[1, u, v] += weight * a * b
                    m[1, u + 1, v] += weight * c * d
                    m[2, u, v] += weight * a * c
                    m[2, u, v + 1] += weight * b * d
                    m[3, u, v] += weight * a * d
                    m[4, u, v + 1] += weight * b * c
                    count[g] += 1
                    for channel in range(channels):
                        value = weight * values[channel, k, i, j]
                        side = right_side[g, channel]
                        side[u, v] += a * value
                        side[u, v + 1] += b * value
                        side[u + 1, v] += c * value
                        side[u + 1, v + 1] += d * value


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
