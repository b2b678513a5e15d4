"""A first displacement of each frame, by search at the coarsest level."""

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.samples import Samples

# Deviations at which a difference counts half, so that occlusion edges do not decide. Pooled weights are
# several times those of a pixel, and edges alias at this level.
HALF = 30.0
LEAST_OVERLAP = 0.4  # of the frame's used pixels


def search_shifts(
    samples: Samples, reference: int, centre: NDArray[np.float64], radius: tuple[int, int]
) -> NDArray[np.float64]:
    """Displacement (N, 2) of each frame from the reference, in full-resolution pixels.

    Tries every whole-pixel displacement of the level within `radius` of `centre` (N, 2, full-resolution
    pixels) and takes the least mean saturating difference over the overlap; of equals the one nearest to the
    centre.
    """
    factor = 2**samples.level
    middle = np.rint(centre / factor).astype(np.int64)
    best = _search(samples.values, samples.weights, reference, middle, radius[0], radius[1])
    moved = best != 0
    return np.where(moved, (middle + best) * factor, centre).astype(np.float64)


@numba.njit(cache=True, parallel=True, fastmath=True)
def _search(values, weights, reference, middle, rows, columns):  # type: ignore[no-untyped-def]
    channels, count, height, width = values.shape
    found = np.zeros((count, 2), dtype=np.int64)
    stride = 1 if height < 32 else 2  # every second row is plenty
    one, knee = np.float32(1.0), np.float32(HALF * HALF)
    # w v / (w + v) = 1 / (1/w + 1/v); a pixel that is not used has a huge variance.
    variance = np.empty_like(weights)
    for k in numba.prange(count):
        for i in range(height):
            for j in range(width):
                w = weights[k, i, j]
                variance[k, i, j] = one / w if w > 0.0 else np.float32(1e32)
    for k in numba.prange(count):
        if k == reference:
            continue
        own = (weights[k, ::stride] > 0).sum()
        lowest = np.inf
        for a in range(-rows, rows + 1):
            for b in range(-columns, columns + 1):
                dy, dx = middle[k, 0] + a, middle[k, 1] + b
                cost, seen = np.float32(0.0), np.float32(0.0)
                for i in range(max(0, -dy), min(height, height - dy), stride):
                    first, last = max(0, -dx), min(width, width - dx)
                    used, other = variance[k, i], variance[reference, i + dy]
                    for j in range(first, last):
                        both = used[j] + other[j + dx]
                        square = np.float32(0.0)
                        for h in range(channels):
                            change = values[h, k, i, j] - values[h, reference, i + dy, j + dx]
                            square += change * change
                        # s / (s + knee) with s = square / both
                        known = np.float32(both < 1e30)
                        cost += known * square / (square + knee * both)
                        seen += known
                if seen < LEAST_OVERLAP * own or seen == 0:
                    continue
                # A thousandth a pixel settles ties, as in a featureless scene.
                mean = cost / seen + 0.001 * np.sqrt(float(a * a + b * b))
                if mean < lowest:
                    lowest = mean
                    found[k, 0], found[k, 1] = a, b
    return found
