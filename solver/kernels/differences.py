"""One walk over the samples for what the noise law and the choice of λ need of them."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def thinned(values, others, least, most):  # type: ignore[no-untyped-def]
    """About `most` of the finite values (N, H, W) over `least` beside another finite one, or all there are.

    They are looked up at even distances that visit all columns in turn, four times as densely as long as
    fewer than a quarter of what is wanted turns up.

    Args:
        values: (N, H, W).
        others: (N, H, W).
    """
    a, b, columns = values.reshape(-1), others.reshape(-1), values.shape[2]
    step = max(1, a.size // most)
    while True:
        while step > 1 and math.gcd(step, columns) > 1:
            step -= 1
        out, count = np.empty((a.size + step - 1) // step, values.dtype), 0
        for n in range(0, a.size, step):
            if a[n] > least and np.isfinite(a[n]) and np.isfinite(b[n]):
                out[count] = a[n]
                count += 1
        if step == 1 or 4 * count >= most:
            return out[:count]
        step = max(1, step // 4)


@njit(cache=True)
def _second_difference(image, i, j, corner, side, centre):  # type: ignore[no-untyped-def]
    """The mask [corner side corner; side centre side; corner side corner] around pixel (i, j)."""
    corners = image[i - 1, j - 1] + image[i - 1, j + 1] + image[i + 1, j - 1] + image[i + 1, j + 1]
    sides = image[i - 1, j] + image[i + 1, j] + image[i, j - 1] + image[i, j + 1]
    return corner * corners + side * sides + centre * image[i, j]


@njit(cache=True, error_model="numpy")
def mixed_differences(distance, inverse, ambiguity):  # type: ignore[no-untyped-def]
    """The finite |mixed second differences| of frames (N, H, W) over their deviations (σ² = inverse); these.

    Args:
        inverse: 1 / amplitude² like distance, or (0, H, W): every deviation is then that for σ = 1. Where it
            is infinite, a sample tells nothing of the noise.
        ambiguity: the ambiguity range, whole ones of which are taken off; 0 = none.
    """
    frames, rows, columns = distance.shape
    ratios = np.empty(frames * max(0, rows - 2) * max(0, columns - 2), np.float32)
    scales = np.empty_like(ratios)
    one, two, four, six = np.float32(1), np.float32(2), np.float32(4), np.float32(6)
    count = 0
    for k in range(frames):
        for i in range(1, rows - 1):
            for j in range(1, columns - 1):
                value = _second_difference(distance[k], i, j, one, -two, four)
                if ambiguity > 0:
                    value -= ambiguity * np.float32(np.round(value / ambiguity))
                scale = six
                if inverse.shape[0] > 0:
                    scale = np.sqrt(_second_difference(inverse[k], i, j, one, four, four * four))
                ratio = np.float32(abs(value) / scale)
                if np.isfinite(ratio) and np.isfinite(scale):
                    ratios[count], scales[count] = ratio, scale
                    count += 1
    return ratios[:count], scales[:count]


@njit(cache=True, error_model="numpy")
def light(distance, amplitude, noise, threshold, sigma, lit):  # type: ignore[no-untyped-def]
    """sigma ← noise / amplitude, lit ← distance where the amplitude reaches the threshold; all (n,).

    sigma is infinite where it is dark, lit is NaN elsewhere. Returns the number of samples left.

    Args:
        distance: (n,), any unit.
        amplitude: (n,), any unit.
        noise: deviation times amplitude.
        sigma: (n,), in distance's unit ←.
        lit: (n,), in distance's unit ←.
    """
    count = 0
    for n in range(distance.size):
        a, d = amplitude[n], distance[n]
        sigma[n] = noise / a if a > 0 else np.float32(np.inf)
        kept = a >= threshold
        lit[n] = d if kept else np.float32(np.nan)
        count += kept and d == d
    return count
