"""Frames as phasors, and pooled by two; mosaics of pooled frames."""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True, error_model="numpy")
def pool(values, weights, mean, total):  # type: ignore[no-untyped-def]
    """mean, total ← weighted means over 2 × 2 pixels, and the sums of their weights.

    Args:
        values: (C, N, H, W), in deviations.
        weights: (N, H, W), 1 / variance.
        mean: (C, N, H / 2, W / 2) ←.
        total: (N, H / 2, W / 2) ←.
    """
    channels, count, rows, columns = mean.shape
    least, few, no = np.float32(1e-30), np.float32(3.0), np.float32(0.0)
    for k in range(count):
        for i in range(rows):
            # Views, and one channel after the other: so the loops are vectorised.
            above, below, out = weights[k, 2 * i], weights[k, 2 * i + 1], total[k, i]
            for h in range(channels):
                up, low, into = values[h, k, 2 * i], values[h, k, 2 * i + 1], mean[h, k, i]
                for j in range(columns):
                    a, b, c, d = above[2 * j], above[2 * j + 1], below[2 * j], below[2 * j + 1]
                    top = a * up[2 * j] + b * up[2 * j + 1]
                    into[j] = (top + c * low[2 * j] + d * low[2 * j + 1]) / max(a + b + c + d, least)
            for j in range(columns):
                a, b, c, d = above[2 * j], above[2 * j + 1], below[2 * j], below[2 * j + 1]
                used = np.float32(a > no) + np.float32(b > no) + np.float32(c > no) + np.float32(d > no)
                # A block that is mostly missing would be a sample at another place.
                out[j] = a + b + c + d if used >= few else no


@njit(cache=True, error_model="numpy")
def write_phasors(distance, amplitude, rate, middle, factor, values, weights):  # type: ignore[no-untyped-def]
    """values ← (A cos, A sin of 2π d · rate, less their middle) · factor; weights ← 1 where known, else 0.

    Written out so that it is vectorised: sine and cosine of half the angle, by their Taylor series.

    Args:
        distance: (N, H, W), any unit.
        amplitude: (N, H, W), any unit.
        rate: 1 / ambiguity range, in distance's unit.
        middle: (2,), in amplitude's unit.
        factor: 1 / deviation.
        values: (2, N, H, W), in deviations.
        weights: (N, H, W).
    """
    count, height, width = distance.shape
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    two, pi = np.float32(2.0), np.float32(np.pi)
    s3, s5, s7 = np.float32(-1 / 6), np.float32(1 / 120), np.float32(-1 / 5040)
    s9, c2, c4 = np.float32(1 / 362880), np.float32(-1 / 2), np.float32(1 / 24)
    c6, c8, c10 = np.float32(-1 / 720), np.float32(1 / 40320), np.float32(-1 / 3628800)
    for k in range(count):
        for i in range(height):
            d, light, weight = distance[k, i], amplitude[k, i], weights[k, i]
            real, imaginary = values[0, k, i], values[1, k, i]
            for j in range(width):
                cycles = d[j] * rate
                h = pi * (cycles - np.floor(cycles + half))
                q = h * h
                sine = h * (one + q * (s3 + q * (s5 + q * (s7 + q * s9))))
                cosine = one + q * (c2 + q * (c4 + q * (c6 + q * (c8 + q * c10))))
                x = (light[j] * (one - two * sine * sine) - middle[0]) * factor
                y = (light[j] * (two * sine * cosine) - middle[1]) * factor
                known = x - x == zero  # neither NaN nor infinite
                real[j] = x if known else zero
                imaginary[j] = y if known else zero
                weight[j] = one if known else zero


@njit(cache=True, fastmath=True)
def pool_nodes(image, away, pooled):  # type: ignore[no-untyped-def]
    """pooled ← the mosaic of frames pooled by two, on every second node.

    Args:
        image: (C, rows, columns), in deviations.
        away: half a pixel, in nodes, at most one.
        pooled: (C, rows / 2, columns / 2).
    """
    channels, rows, columns = image.shape
    side, middle = np.float32(0.5) * away, np.float32(1.0) - away
    line = np.empty(columns, np.float32)
    for h in range(channels):
        for i in range(pooled.shape[1]):
            own, above, below = (
                image[h, 2 * i],
                image[h, max(2 * i - 1, 0)],
                image[h, min(2 * i + 1, rows - 1)],
            )
            for j in range(columns):
                line[j] = middle * own[j] + side * (above[j] + below[j])
            out = pooled[h, i]
            for j in range(len(out)):
                n = 2 * j
                out[j] = middle * line[n] + side * (line[max(n - 1, 0)] + line[min(n + 1, columns - 1)])
