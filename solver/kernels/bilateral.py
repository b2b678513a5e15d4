"""Bilateral total variation: half its gradient, and its value."""

import numpy as np
from numba import njit, prange


@njit(cache=True, parallel=True)
def bilateral(image, weights, factor):  # type: ignore[no-untyped-def]
    """factor · Σ α^{|l|+|m|} sign(X(p) − X(p + (m, l))) over the window.

    An offset and its opposite are the two terms of (I − S⁻¹) sign(X − S X): this sum is half the gradient.

    Args:
        image: (rows, columns), in the unit of the prior.
        weights: (2 P + 1, 2 P + 1), α^{|l|+|m|}, 0 in the middle.
        factor: of the whole sum.
    """
    rows, columns = image.shape
    reach = weights.shape[0] // 2
    result = np.zeros_like(image)
    for i in prange(rows):
        for m in range(-reach, reach + 1):
            if i + m < 0 or i + m >= rows:
                continue
            for n in range(-reach, reach + 1):
                weight = weights[m + reach, n + reach] * factor
                first, last = max(0, -n), min(columns, columns - n)
                own, other = image[i, first:last], image[i + m, first + n : last + n]
                out = result[i, first:last]
                for j in range(last - first):
                    difference = own[j] - other[j]
                    out[j] += weight * (np.float32(difference > 0) - np.float32(difference < 0))
    return result


@njit(cache=True, parallel=True)
def bilateral_value(image, weights):  # type: ignore[no-untyped-def]
    """Σ α^{|l|+|m|} |X(p) − X(p + (m, l))| over the window.

    Args:
        image: (rows, columns), in the unit of the prior.
        weights: (2 P + 1, 2 P + 1), α^{|l|+|m|}, 0 in the middle.
    """
    rows, columns = image.shape
    reach = weights.shape[0] // 2
    total = 0.0
    for i in prange(rows):
        for m in range(-reach, reach + 1):
            if i + m < 0 or i + m >= rows:
                continue
            for n in range(-reach, reach + 1):
                first, last = max(0, -n), min(columns, columns - n)
                row = np.float32(0.0)
                for j in range(first, last):
                    row += abs(image[i, j] - image[i + m, j + n])
                total += float(weights[m + reach, n + reach] * row)
    return total
