"""The sparse data term: scattering samples, and its value."""

import numpy as np
from numba import njit


@njit(cache=True, inline="always")
def _under(position, scale, top, end):  # type: ignore[no-untyped-def]
    """The row or column under a sample, where it lies from `top` on and before `end`; −1 elsewhere."""
    at = (np.float64(position) + 0.5) * scale
    return np.int64(at) if top <= at < end else np.int64(-1)  # also refuses NaN


@njit(nogil=True, cache=True)
def scatter(rank, size, values, weights, positions, scale, weight, total, squares):  # type: ignore[no-untyped-def]
    """Add every sample (N, H, W) to the fused pixel floor((position + ½) · scale) under its centre.

    Samples of weight 0 are not used. Adds Σ w to weight and Σ w d to total, and Σ w d² by row of theirs to
    squares, in float64. Each thread of a team walks all samples and takes those that fall on its own rows.

    Args:
        values: (N, H, W), any unit.
        weights: (N, H, W), 0 = not used.
        positions: (N, H, W, 2), pixels of frame 0.
        scale: β.
        weight: (rows, columns), in place.
        total: (rows, columns), in place.
        squares: (rows,), in float64, in place.
    """
    frames, rows, columns = values.shape
    top, end = rank * weight.shape[0] // size, (rank + 1) * weight.shape[0] // size
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                u = _under(positions[k, i, j, 0], scale, top, end)
                if u < 0 or not weights[k, i, j] > 0:
                    continue
                v = _under(positions[k, i, j, 1], scale, 0, weight.shape[1])
                if v >= 0:
                    w, value = weights[k, i, j], values[k, i, j]
                    weight[u, v] += w
                    total[u, v] += w * value
                    squares[u] += np.float64(w) * np.float64(value) * np.float64(value)


@njit(nogil=True, cache=True, error_model="numpy")
def scatter_precision(  # type: ignore[no-untyped-def]
    rank, size, distance, sigma, positions, scale, usual, sign, precision
):
    """Add sign · (usual / σ)² of every sample that is not NaN to the fused pixel under it.

    It is rounded to a whole number of 1/1024, from 1 of them to 512, so that sums are exact: what is taken
    away again leaves nothing.

    Args:
        distance: (N, H, W), any unit, NaN = none.
        sigma: (N, H, W), deviations in distance's unit.
        positions: (N, H, W, 2), pixels of frame 0.
        scale: β.
        usual: the usual deviation.
        sign: 1 or −1.
        precision: (rows, columns), in 1 / usual², in place.
    """
    step, most = np.float32(1024), np.float32(512)
    frames, rows, columns = distance.shape
    top, end = rank * precision.shape[0] // size, (rank + 1) * precision.shape[0] // size
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                u = _under(positions[k, i, j, 0], scale, top, end)
                if u < 0 or np.isnan(distance[k, i, j]):
                    continue
                v = _under(positions[k, i, j, 1], scale, 0, precision.shape[1])
                if v >= 0:
                    ratio = usual / sigma[k, i, j]
                    steps = np.round(min(ratio * ratio, most) * step)
                    precision[u, v] += sign * max(steps, np.float32(1)) / step


@njit(cache=True, error_model="numpy", fastmath=True)
def average(weight, total):  # type: ignore[no-untyped-def]
    """total ← total / weight = m, 0 where w = 0; returns Σ w m² in float64, the least and the largest m.

    Args:
        weight: (rows, columns), w.
        total: (rows, columns), any unit, in place.
    """
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
    """sums ← Σ w (x − m)² by row.

    Args:
        x: (rows + 4, columns + 4), padded by 2, in units of λ.
        weight: (rows + 4, columns + 4), padded by 2, w in 1 / λ².
        mean: (rows + 4, columns + 4), padded by 2, m in units of λ.
        sums: (rows,), in float64.
    """
    rows, n = x.shape[0] - 4, x.shape[1] - 4
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        a, w, m = x[row + 2, 2 : 2 + n], weight[row + 2, 2 : 2 + n], mean[row + 2, 2 : 2 + n]
        value = 0.0
        for j in range(n):
            value += w[j] * (a[j] - m[j]) * (a[j] - m[j])
        sums[row] = value
