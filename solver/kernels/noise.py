"""One walk over the samples for what the noise law and the choice of λ need of them."""

import numpy as np
from numba import njit


@njit(cache=True)
def thinned(values, others, most):  # type: ignore[no-untyped-def]
    """The finite values (N, H, W) beside another finite one, evenly thinned to `most` up to twice as many."""
    frames, rows, columns = values.shape
    count = 0
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                count += np.isfinite(values[k, i, j]) and np.isfinite(others[k, i, j])
    step = max(1, count // most)
    out = np.empty((count + step - 1) // step, values.dtype)
    number, next_one = 0, 0
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                if np.isfinite(values[k, i, j]) and np.isfinite(others[k, i, j]):
                    if number == next_one:
                        out[number // step] = values[k, i, j]
                        next_one += step
                    number += 1
    return out


@njit(cache=True)
def _second_difference(image, i, j, corner, side, centre):  # type: ignore[no-untyped-def]
    """The mask [corner side corner; side centre side; corner side corner] around pixel (i, j)."""
    corners = image[i - 1, j - 1] + image[i - 1, j + 1] + image[i + 1, j - 1] + image[i + 1, j + 1]
    sides = image[i - 1, j] + image[i + 1, j] + image[i, j - 1] + image[i, j + 1]
    return corner * corners + side * sides + centre * image[i, j]


@njit(cache=True, error_model="numpy")
def mixed_differences(distance, inverse, span):  # type: ignore[no-untyped-def]
    """The finite |mixed second differences| of frames (N, H, W), each over its deviation for σ = inverse.

    Args:
        inverse: 1 / amplitude² like distance, or (0, H, W): every deviation is then that for σ = 1.
        span: the ambiguity range, whole ones of which are taken off; 0 = none.
    """
    frames, rows, columns = distance.shape
    out = np.empty(frames * max(0, rows - 2) * max(0, columns - 2), np.float32)
    one, two, four, six = np.float32(1), np.float32(2), np.float32(4), np.float32(6)
    count = 0
    for k in range(frames):
        for i in range(1, rows - 1):
            for j in range(1, columns - 1):
                value = _second_difference(distance[k], i, j, one, -two, four)
                if span > 0:
                    value -= span * np.float32(np.round(value / span))
                scale = six
                if inverse.shape[0] > 0:
                    scale = np.sqrt(_second_difference(inverse[k], i, j, one, four, four * four))
                ratio = np.float32(abs(value) / scale)
                if np.isfinite(ratio):
                    out[count] = ratio
                    count += 1
    return out[:count]


@njit(cache=True)
def standing(distance, sigma, picked, most):  # type: ignore[no-untyped-def]
    """(2,): the mean step down and the mean step across of the picked frames of (N, H, W).

    Steps between two known samples count, those of at most `most` deviations of themselves as none.
    """
    rows, columns = distance.shape[1:]
    sums, counts = np.zeros(2), np.zeros(2)
    for k in picked:
        for i in range(rows):
            for j in range(columns):
                for axis in range(2):
                    a, b = i + 1 - axis, j + axis
                    if a == rows or b == columns:
                        continue
                    step = abs(distance[k, a, b] - distance[k, i, j])
                    variance = sigma[k, a, b] ** 2 + sigma[k, i, j] ** 2
                    if np.isfinite(step) and np.isfinite(variance):
                        counts[axis] += 1
                        if step * step > most * most * variance:
                            sums[axis] += step
    return sums / np.maximum(counts, 1)


@njit(cache=True)
def middle(values, bits, others):  # type: ignore[no-untyped-def]
    """The median of the positive float32 values (n,) beside an other that is not NaN; 0 where there is none.

    `bits` are the values as int32, whose order is that of positive values: three counts of ten or eleven bits
    find the value of a rank without a copy.
    """
    table = np.zeros(2048, np.int64)
    for n in range(values.size):
        if values[n] > 0 and others[n] == others[n]:
            table[bits[n] >> 20] += 1
    count = table.sum()
    if count == 0:
        return 0.0
    rank = (count - 1) // 2
    prefix, left = _bin(table, rank)
    for shift in (10, 0):
        table[:] = 0
        for n in range(values.size):
            if bits[n] >> (shift + 10) == prefix and values[n] > 0 and others[n] == others[n]:
                table[(bits[n] >> shift) & 1023] += 1
        digit, left = _bin(table, left)
        prefix = (prefix << 10) | digit
    low = high = np.float32(0)
    above, until = np.float32(np.inf), 0
    for n in range(values.size):
        if values[n] > 0 and others[n] == others[n]:
            if bits[n] <= prefix:
                until += 1
                low = max(low, values[n])
            else:
                above = min(above, values[n])
    high = low if until > count // 2 else above
    return 0.5 * (float(low) + float(high))


@njit(cache=True)
def _bin(table, rank):  # type: ignore[no-untyped-def]
    """The entry that holds a rank, and the rank within it."""
    for entry in range(table.size):
        if rank < table[entry]:
            return entry, rank
        rank -= table[entry]
    return table.size, rank


@njit(cache=True, error_model="numpy")
def light(distance, amplitude, noise, threshold, sigma, lit):  # type: ignore[no-untyped-def]
    """sigma ← noise / amplitude, lit ← distance where the amplitude reaches the threshold; all (n,).

    sigma is infinite where it is dark, lit is NaN elsewhere. Returns the number of samples left.
    """
    count = 0
    for n in range(distance.size):
        a, d = amplitude[n], distance[n]
        sigma[n] = noise / a if a > 0 else np.float32(np.inf)
        kept = a >= threshold
        lit[n] = d if kept else np.float32(np.nan)
        count += kept and d == d
    return count
