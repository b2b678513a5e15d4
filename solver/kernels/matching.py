"""The whole displacement at which two frames look most alike."""

import numpy as np
from numba import njit

HALF = 30.0
UNUSED = np.float32(1e32)
LEAST_OVERLAP = 0.4  # of the frame's used pixels


@njit(cache=True, fastmath=True, error_model="numpy")
def _compare(values, variance, k, reference, dy, dx, stride, buffer):  # type: ignore[no-untyped-def]
    """Sum of the saturating differences at a displacement, and how many pixels overlap."""
    channels, _, height, width = values.shape
    begin, end = max(0, -dx), min(width, width - dx)
    knee, most = np.float32(HALF * HALF), np.float32(0.5 * UNUSED)
    cost, seen = np.float32(0.0), np.float32(0.0)
    if begin >= end:
        return cost, seen
    square = buffer[: end - begin]
    for i in range(max(0, -dy), min(height, height - dy), stride):
        square[:] = np.float32(0.0)
        for h in range(channels):
            x, y = values[h, k, i, begin:end], values[h, reference, i + dy, begin + dx : end + dx]
            for j in range(len(square)):
                change = x[j] - y[j]
                square[j] += change * change
        used, other = variance[k, i, begin:end], variance[reference, i + dy, begin + dx : end + dx]
        for j in range(len(square)):
            both = used[j] + other[j]
            known = np.float32(both < most)
            # s / (s + knee) with s = square / both
            cost += known * square[j] / (square[j] + knee * both)
            seen += known
    return cost, seen


@njit(cache=True)
def search(values, weights, reference, middle, rows, columns, better):  # type: ignore[no-untyped-def]
    """(N, 2): the displacement of each frame, in whole pixels, at which it is most like the reference.

    Args:
        values: (C, N, H, W), in deviations.
        weights: (N, H, W), 1 / variance, 0 = not used.
        reference: number of the frame.
        middle: (N, 2), where the search is centred, pixels.
        rows: that it reaches to either side.
        columns: that it reaches to either side.
        better: factor on the cost of the middle.
    """
    count, height = weights.shape[:2]
    found = np.zeros((count, 2), dtype=np.int64)
    stride = 1 if height < 32 else 2  # every second row is plenty
    # w v / (w + v) = 1 / (1/w + 1/v); a pixel that is not used has a huge variance.
    variance = np.empty_like(weights)
    used = np.zeros(count, np.int64)
    for k in range(count):
        for i in range(height):
            for j in range(weights.shape[2]):
                weight = weights[k, i, j]
                variance[k, i, j] = (
                    np.float32(1.0) / max(weight, np.float32(1e-32)) if weight > 0.0 else UNUSED
                )
                used[k] += weight > 0.0 and i % stride == 0
    buffer = np.empty(weights.shape[2], dtype=np.float32)
    for k in range(count):
        if k == reference:
            continue
        lowest = np.inf
        for a in range(-rows, rows + 1):
            for b in range(-columns, columns + 1):
                dy, dx = middle[k, 0] + a, middle[k, 1] + b
                cost, seen = _compare(values, variance, k, reference, dy, dx, stride, buffer)
                if seen < LEAST_OVERLAP * used[k] or seen == 0:
                    continue
                # A thousandth a pixel settles ties, as in a featureless scene.
                mean = cost / seen + 0.001 * np.sqrt(float(a * a + b * b))
                if a == 0 and b == 0:
                    mean *= better
                if mean < lowest:
                    lowest = mean
                    found[k, 0], found[k, 1] = a, b
    return found
