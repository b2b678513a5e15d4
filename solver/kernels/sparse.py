"""The sparse data term: scattering samples, its value, and its half of the dual bound."""

import numpy as np
from numba import njit, prange


@njit(parallel=True, cache=True)
def scatter(values, weights, positions, scale, weight, total, squares):  # type: ignore[no-untyped-def]
    """Add every sample (N, H, W) to the fused pixel floor((position + ½) · scale) under its centre.

    Samples of weight 0 are not used. Adds Σ w to weight (G, …), Σ w d to total (G, …), Σ w d² to squares
    (G,): G partial sums, which the caller adds up.
    """
    groups = weight.shape[0]
    frames, rows, columns = values.shape
    for g in prange(groups):
        mass, moment = weight[g], total[g]
        fine_rows, fine_columns = mass.shape
        for k in range(g * frames // groups, (g + 1) * frames // groups):
            for i in range(rows):
                for j in range(columns):
                    w = weights[k, i, j]
                    if w <= 0:
                        continue
                    u = np.floor((float(positions[k, i, j, 0]) + 0.5) * scale)
                    v = np.floor((float(positions[k, i, j, 1]) + 0.5) * scale)
                    if 0 <= u < fine_rows and 0 <= v < fine_columns:
                        value = values[k, i, j]
                        mass[int(u), int(v)] += w
                        moment[int(u), int(v)] += w * value
                        squares[g] += float(w) * float(value) * float(value)


@njit(parallel=True, fastmath=True, cache=True)
def misfit(x, weight, mean):  # type: ignore[no-untyped-def]
    """Σ w (x − m)² in float64; arrays (rows, columns) padded by 2."""
    rows, n = x.shape[0] - 4, x.shape[1] - 4
    sums = np.zeros(rows)
    for row in prange(rows):
        a, w, m = x[row + 2, 2 : 2 + n], weight[row + 2, 2 : 2 + n], mean[row + 2, 2 : 2 + n]
        value = 0.0
        for j in range(n):
            value += w[j] * (a[j] - m[j]) * (a[j] - m[j])
        sums[row] = value
    return sums.sum()


@njit(parallel=True, cache=True)
def least(slope, weight, mean, low, high):  # type: ignore[no-untyped-def]
    """Σ over pixels of the least w (x − m)² + slope · x over x in [low, high], in float64.

    The bounds are those of the data: clipping a map to them lowers every term of the objective, so they
    change no minimum, and they keep the sum finite where no sample falls (w = 0).
    """
    rows, columns = weight.shape
    sums = np.zeros(rows)
    for i in prange(rows):
        for j in range(columns):
            w, m, z = float(weight[i, j]), float(mean[i, j]), float(slope[i, j])
            free = m - z / (2 * w) if w > 0 else (low if z > 0 else high)
            best = min(max(free, low), high)
            sums[i] += w * (best - m) ** 2 + z * best
    return sums.sum()


@njit(cache=True)
def extremes(distance, kept, positions, low, high):  # type: ignore[no-untyped-def]
    """Least and largest kept sample (N, H, W) over each low-resolution pixel, into low and high (H, W)."""
    frames, rows, columns = distance.shape
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                if not kept[k, i, j]:
                    continue
                u = np.floor(float(positions[k, i, j, 0]) + 0.5)
                v = np.floor(float(positions[k, i, j, 1]) + 0.5)
                if 0 <= u < rows and 0 <= v < columns:
                    value = distance[k, i, j]
                    low[int(u), int(v)] = min(low[int(u), int(v)], value)
                    high[int(u), int(v)] = max(high[int(u), int(v)], value)
