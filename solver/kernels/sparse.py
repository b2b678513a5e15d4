"""The sparse data term: scattering samples, and its value."""

import numpy as np
from numba import njit


@njit(cache=True)
def scatter(values, weights, positions, scale, weight, total):  # type: ignore[no-untyped-def]
    """Add every sample (N, H, W) to the fused pixel floor((position + ½) · scale) under its centre.

    Samples of weight 0 are not used. Adds Σ w to weight and Σ w d to total; returns Σ w d² in float64. One
    thread does it: a second one would need sums of its own, and fresh memory costs more than it saves.
    """
    frames, rows, columns = values.shape
    fine_rows, fine_columns = weight.shape
    squares = 0.0
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                w = weights[k, i, j]
                if w <= 0:
                    continue
                u = (float(positions[k, i, j, 0]) + 0.5) * scale
                v = (float(positions[k, i, j, 1]) + 0.5) * scale
                if 0 <= u < fine_rows and 0 <= v < fine_columns:
                    value = values[k, i, j]
                    weight[int(u), int(v)] += w
                    total[int(u), int(v)] += w * value
                    squares += float(w) * float(value) * float(value)
    return squares


@njit(cache=True, error_model="numpy")
def scatter_precision(distance, sigma, positions, scale, usual, least, precision):  # type: ignore[no-untyped-def]
    """Add (usual / σ)², at least `least`, of every sample that is not NaN to the fused pixel under it.

    Args: distance, sigma (N, H, W); the others as in `scatter`.
    """
    frames, rows, columns = distance.shape
    fine_rows, fine_columns = precision.shape
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                u = (float(positions[k, i, j, 0]) + 0.5) * scale
                v = (float(positions[k, i, j, 1]) + 0.5) * scale
                if not np.isnan(distance[k, i, j]) and 0 <= u < fine_rows and 0 <= v < fine_columns:
                    ratio = usual / sigma[k, i, j]
                    precision[int(u), int(v)] += max(ratio * ratio, least)


@njit(cache=True, error_model="numpy", fastmath=True)
def average(weight, total):  # type: ignore[no-untyped-def]
    """total ← total / weight = m, 0 where w = 0; returns Σ w m² in float64, the least and the largest m."""
    rows, columns = weight.shape
    square, low, high = 0.0, np.float32(np.finfo(np.float32).max), np.float32(np.finfo(np.float32).min)
    for i in range(rows):
        w, m = weight[i], total[i]
        for j in range(columns):
            seen = w[j] > 0
            mean = m[j] / w[j] if seen else np.float32(0)
            m[j] = mean
            square += float(w[j]) * float(mean) * float(mean)
            low = min(low, mean if seen else low)
            high = max(high, mean if seen else high)
    return square, low, high


@njit(nogil=True, fastmath=True, cache=True)
def misfit(rank, size, x, weight, mean, sums):  # type: ignore[no-untyped-def]
    """sums (rows,) ← Σ w (x − m)² by row in float64; arrays (rows, columns) padded by 2."""
    rows, n = x.shape[0] - 4, x.shape[1] - 4
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        a, w, m = x[row + 2, 2 : 2 + n], weight[row + 2, 2 : 2 + n], mean[row + 2, 2 : 2 + n]
        value = 0.0
        for j in range(n):
            value += w[j] * (a[j] - m[j]) * (a[j] - m[j])
        sums[row] = value


@njit(cache=True)
def extremes(distance, sigma, most, positions, low, high):  # type: ignore[no-untyped-def]
    """Least and largest sample (N, H, W) over each low-resolution pixel, into low and high (H, W).

    Samples that are NaN or deviate by more than `most` are left out.
    """
    frames, rows, columns = distance.shape
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                value = distance[k, i, j]
                if np.isnan(value) or not sigma[k, i, j] <= most:
                    continue
                u = float(positions[k, i, j, 0]) + 0.5
                v = float(positions[k, i, j, 1]) + 0.5
                if 0 <= u < rows and 0 <= v < columns:
                    low[int(u), int(v)] = min(low[int(u), int(v)], value)
                    high[int(u), int(v)] = max(high[int(u), int(v)], value)
