"""The data term of area footprints: Σ Ω (y − A X)², with A X bilinear interpolation of the blurred map B X.

Every sample touches 2 × 2 nodes of B X, so Σ Aᵀ Ω A = Bᵀ M B with M a symmetric nine-point stencil, kept as
five coefficient images: the node itself, its neighbours to the right, below, below right and below left. Node
(0, 0) is the blur of the map's first taps × taps pixels. Images of nodes are padded by 1, and a sample's
first node is known by its number in them, counted along rows: one comparison tells where it belongs.
"""

import numpy as np
from numba import njit

_BAND_ROWS = 32
"""Of M and b: few enough to stay in cache, many enough that few samples fall between two bands."""


@njit(nogil=True, cache=True, error_model="numpy")
def place(rank, size, weights, positions, scale, offset, shape, nodes, fractions, spans):  # type: ignore[no-untyped-def]
    """Find each sample's first node and where it lies between that and the next ones; by a team.

    Args:
        weights: (N, H, W), 0 = not used; positions: (N, H, W, 2).
        scale: β; offset: node of a footprint centred on coordinate 0 of the fused grid's edges.
        shape: (rows, columns) of nodes.
        nodes: (N, H, W) int32 ← the node's number in a padded image, −1 = not used.
        fractions: (2, N, H, W) ← parts of a node by row and by column.
        spans: (N, H, 2) ← the least and the largest node of each frame row, (all nodes, −1): none.
    """
    frames, rows = weights.shape[:2]
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        down, right = fractions[0, k, i], fractions[1, k, i]
        _place_row(weights[k, i], positions[k, i], scale, offset, shape, nodes[k, i], down, right)
        spans[k, i, 0], spans[k, i, 1] = _extent(nodes[k, i], (shape[0] + 2) * (shape[1] + 2))


@njit(fastmath={"contract"})
def _place_row(weights, positions, scale, offset, shape, nodes, down, right):  # type: ignore[no-untyped-def]
    n, nothing, half = weights.size, np.float64(0), np.float64(0.5)
    last_row, last_column = np.float64(shape[0] - 1), np.float64(shape[1] - 1)
    width, one, none = np.float64(shape[1] + 2), np.float64(1), np.float64(-1)
    ws, numbers, downs, rights = weights[:n], nodes[:n], down[:n], right[:n]
    for j in range(n):
        u = (np.float64(positions[j, 0]) + half) * scale + offset
        v = (np.float64(positions[j, 1]) + half) * scale + offset
        r = min(np.float64(np.int32(u)), last_row - one)
        s = min(np.float64(np.int32(v)), last_column - one)
        # A footprint that leaves the map has no node; comparisons also refuse NaN.
        kept = (ws[j] > 0) & (u >= nothing) & (u <= last_row) & (v >= nothing) & (v <= last_column)
        downs[j], rights[j] = u - r, v - s
        numbers[j] = np.int32((r + one) * width + s + one if kept else none)


@njit
def _extent(nodes, none):  # type: ignore[no-untyped-def]
    """The least and the largest of those from 0 on; (none, −1) where there are none."""
    low, high = np.int32(none), np.int32(-1)
    for j in range(nodes.size):
        low = min(low, nodes[j] if nodes[j] >= 0 else low)
        high = max(high, nodes[j])
    return low, high


@njit(nogil=True, cache=True)
def accumulate(rank, size, values, weights, nodes, fractions, spans, stencil, side):  # type: ignore[no-untyped-def]
    """Add frames to M and b; by a team.

    Bands of node rows are filled one by one, which keeps them in cache and gives each band one writer.

    Args:
        values: (C, N, H, W), in units of λ.
        weights: (N, H, W), in 1 / λ², 0 = not used.
        nodes: (N, H, W), of `place`.
        fractions: (2, N, H, W), of `place`.
        spans: (N, H, 2), of `place`.
        stencil: (5, nodes + 2, nodes + 2), M, padded by 1.
        side: (C, nodes + 2, nodes + 2), b, padded by 1.
    """
    frames, rows = weights.shape[:2]
    node_rows, width = stencil.shape[1] - 2, stencil.shape[2]
    bands = max(1, node_rows // _BAND_ROWS)
    m, b = stencil.reshape(5, -1), side.reshape(side.shape[0], -1)
    for band in range(rank * bands // size, (rank + 1) * bands // size):
        # Samples whose first node lies in the row above the band still reach it.
        first = (band * node_rows // bands) * width
        end = ((band + 1) * node_rows // bands + 1) * width
        for k in range(frames):
            for i in range(rows):
                if spans[k, i, 1] >= first and spans[k, i, 0] < end:
                    places = nodes[k, i], fractions[0, k, i], fractions[1, k, i]
                    _add_row(values[:, k, i], weights[k, i], *places, first, end, width, m, b)


@njit
def _add_row(values, weights, nodes, down, right, first, end, width, stencil, side):  # type: ignore[no-untyped-def]
    """`accumulate` for one row of a frame and the band from number `first` to `end`; flat images."""
    one, kind = weights.dtype.type(1), weights.dtype.type
    m0, m1, m2, m3, m4 = stencil[0], stencil[1], stencil[2], stencil[3], stencil[4]
    # Unsigned numbers spare Numba's test for negative ones.
    step, below = np.uintp(1), np.uintp(width)
    for j in range(weights.size):
        if not first <= nodes[j] < end:
            continue
        n, w, fu, fv = np.uintp(nodes[j]), weights[j], kind(down[j]), kind(right[j])
        a, b, c, d = (one - fu) * (one - fv), (one - fu) * fv, fu * (one - fv), fu * fv
        wa, wb = w * a, w * b
        if nodes[j] >= first + width:
            m0[n] += wa * a
            m0[n + step] += wb * b
            m1[n] += wa * b
            m2[n] += wa * c
            m2[n + step] += wb * d
            m3[n] += wa * d
            m4[n + step] += wb * c
            for channel in range(side.shape[0]):
                value = values[channel, j]
                side[channel, n] += wa * value
                side[channel, n + step] += wb * value
        if nodes[j] < end - width:
            wc, wd = w * c, w * d
            m0[n + below] += wc * c
            m0[n + below + step] += wd * d
            m1[n + below] += wc * d
            for channel in range(side.shape[0]):
                value = values[channel, j]
                side[channel, n + below] += wc * value
                side[channel, n + below + step] += wd * value


@njit(fastmath={"contract"})
def _interpolate(blurred, nodes, down, right, out):  # type: ignore[no-untyped-def]
    """out ← A X of a row of samples, from a flat image of nodes and its width; 0 where none is used."""
    image, width = blurred
    one, step, below, kind = out.dtype.type(1), np.uintp(1), np.uintp(width), out.dtype.type
    for j in range(out.size):
        n, fu, fv = np.uintp(max(nodes[j], 0)), kind(down[j]), kind(right[j])
        upper = (one - fv) * image[n] + fv * image[n + step]
        lower = (one - fv) * image[n + below] + fv * image[n + below + step]
        out[j] = (one - fu) * upper + fu * lower


@njit(fastmath={"contract", "reassoc", "nsz"})
def _add_sums(values, weights, nodes, model, out):  # type: ignore[no-untyped-def]
    """out (5,) += the sums of `residuals` over one row of samples."""
    n, nothing = model.size, model.dtype.type(0)
    ys, ws, numbers, models = values[:n], weights[:n], nodes[:n], model[:n]
    total = data = fit = square = rest = nothing
    for j in range(n):
        used = numbers[j] >= 0
        w, y, m = (ws[j] if used else nothing), (ys[j] if used else nothing), models[j]
        m = m if used else nothing
        total += w
        data += w * y
        fit += w * m
        square += w * (y - m) * (y - m)
        rest += w * (y - m) * (y + m)
    out[0] += total
    out[1] += data
    out[2] += fit
    out[3] += square
    out[4] += rest


@njit(nogil=True, cache=True, error_model="numpy")
def distrust(  # type: ignore[no-untyped-def]
    rank, size, values, weights, nodes, fractions, spans, blurred, noise, slack, lost, found
):
    """lost (N, H, W) ← what samples lose of their weight w for a residual r beyond noise / √w + slack = a.

    w becomes w (a / r)²; by a team.

    Args:
        values: (C, N, H, W), in units of λ.
        weights: (N, H, W), in 1 / λ², 0 = not used.
        nodes: (N, H, W), of `place`.
        fractions: (2, N, H, W), of `place`.
        spans: (N, H, 2), of `place`.
        blurred: (C, nodes + 2, nodes + 2), B X, padded by 1.
        noise: of a sample of weight 1.
        slack: in units of λ.
        lost: (N, H, W), in 1 / λ².
        found: (N, H, 2) ← the spans of rows in which any loses, none for the others.
    """
    channels, frames, rows, columns = values.shape
    model, square = np.zeros(columns, blurred.dtype), np.zeros(columns, blurred.dtype)
    one = weights.dtype.type(1)
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        found[k, i, 0], found[k, i, 1] = np.int32(blurred[0].size), np.int32(-1)
        if spans[k, i, 1] < 0:
            continue
        square[:] = 0
        for c in range(channels):
            image = blurred[c].reshape(-1), blurred.shape[2]
            _interpolate(image, nodes[k, i], fractions[0, k, i], fractions[1, k, i], model)
            for j in range(columns):
                square[j] += (values[c, k, i, j] - model[j]) * (values[c, k, i, j] - model[j])
        for j in range(columns):
            w = weights[k, i, j]
            allowed = noise / np.sqrt(w) + slack
            if nodes[k, i, j] >= 0 and square[j] > allowed * allowed:
                lost[k, i, j] = w * (allowed * allowed / square[j] - one)
                found[k, i] = spans[k, i]


@njit(nogil=True, cache=True)
def residuals(rank, size, values, weights, nodes, fractions, spans, blurred, sums):  # type: ignore[no-untyped-def]
    """sums (N · H, C, 5) += Ω, Ω y, Ω A X, Ω (y − A X)², Ω (y² − (A X)²) by row and channel; by a team.

    Args:
        values: (C, N, H, W), in units of λ.
        weights: (N, H, W), in 1 / λ², 0 = not used.
        nodes: (N, H, W), of `place`.
        fractions: (2, N, H, W), of `place`.
        spans: (N, H, 2), of `place`.
        blurred: (C, nodes + 2, nodes + 2), B X, padded by 1.
        sums: (N · H, C, 5), in float64.
    """
    channels, frames, rows, columns = values.shape
    model = np.zeros(columns, blurred.dtype)
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        if spans[k, i, 1] < 0:
            continue
        for c in range(channels):
            image = blurred[c].reshape(-1), blurred.shape[2]
            _interpolate(image, nodes[k, i], fractions[0, k, i], fractions[1, k, i], model)
            _add_sums(values[c, k, i], weights[k, i], nodes[k, i], model, sums[line, c])
