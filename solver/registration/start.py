"""A first displacement of each frame, by search at the coarsest level."""

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.samples import Samples

# Deviations at which a difference counts half, so that occlusion edges do not decide. Pooled weights are
# several times those of a pixel, and edges alias at this level.
HALF = 32.0
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


@numba.njit(cache=True, parallel=True)
def _search(values, weights, reference, middle, rows, columns):  # type: ignore[no-untyped-def]
    channels, count, height, width = values.shape
    found = np.zeros((count, 2), dtype=np.int64)
    w0 = weights[reference]
    for k in numba.prange(count):
        if k == reference:
            continue
        own = 0
        for i in range(height):
            for j in range(width):
                own += weights[k, i, j] > 0.0
        lowest = np.inf
        for a in range(-rows, rows + 1):
            for b in range(-columns, columns + 1):
                dy, dx = middle[k, 0] + a, middle[k, 1] + b
                cost, seen = 0.0, 0
                for i in range(max(0, -dy), min(height, height - dy)):
                    for j in range(max(0, -dx), min(width, width - dx)):
                        w, v = weights[k, i, j], w0[i + dy, j + dx]
                        if w > 0.0 and v > 0.0:
                            square = 0.0
                            for h in range(channels):
                                change = values[h, k, i, j] - values[h, reference, i + dy, j + dx]
                                square += change * change
                            size = np.sqrt(square * w * v / (w + v))
                            cost += size / (1.0 + size / HALF)
                            seen += 1
                if seen < LEAST_OVERLAP * own or seen == 0:
                    continue
                # A hundredth a pixel settles ties, as in a featureless scene.
                mean = cost / seen + 0.01 * np.sqrt(float(a * a + b * b))
                if mean < lowest:
                    lowest = mean
                    found[k, 0], found[k, 1] = a, b
    return found
