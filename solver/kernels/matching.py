"""How much alike two frames look at whole displacements."""

import numpy as np
from numba import njit

# Deviations at which a difference counts half, so that occlusion edges do not decide. Pooled weights are
# several times those of a pixel, and edges alias at that level.
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
def compare(values, weights, reference, middle, costs):  # type: ignore[no-untyped-def]
    """costs (N, 2 rows + 1, 2 columns + 1) ← how unlike the reference each frame is at each displacement.

    The mean saturating difference, infinite where too little of a frame overlaps the reference.

    Args:
        values: (C, N, H, W), in deviations.
        weights: (N, H, W), 1 / variance, 0 = not used.
        reference: number of the frame.
        middle: (N, 2), the displacement in the middle of the costs, pixels.
    """
    count, height = weights.shape[:2]
    rows, columns = costs.shape[1] // 2, costs.shape[2] // 2
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
        for a in range(-rows, rows + 1):
            for b in range(-columns, columns + 1):
                dy, dx = middle[k, 0] + a, middle[k, 1] + b
                cost, seen = _compare(values, variance, k, reference, dy, dx, stride, buffer)
                few = seen < LEAST_OVERLAP * used[k] or seen == 0
                costs[k, rows + a, columns + b] = np.inf if few else cost / seen
