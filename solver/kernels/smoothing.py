"""Averages under a Gaussian along and across rows; its taps are the middle one and those on one side.

Of these there are a multiple of three. Borders are mirrored, the last pixel not repeated.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray


def gaussian(deviation: float, reach: int) -> NDArray[np.float64]:
    """The middle tap of a Gaussian of sum 1 and at least `reach` ones on a side, a multiple of three."""
    taps = np.exp(-0.5 * (np.arange(-(-reach // 3) * 3 + 1) / deviation) ** 2)
    return np.asarray(taps / (2 * taps.sum() - taps[0]))


@njit
def mirrored(i, n):  # type: ignore[no-untyped-def]
    """The one of n rows that stands for row i."""
    if n == 1:
        return 0
    i = abs(i) % (2 * n - 2)
    return i if i < n else 2 * n - 2 - i


@njit(fastmath=True)
def along(line, taps, out):  # type: ignore[no-untyped-def]
    """out ← the average along a line, whose n entries begin at the Gaussian's reach and are mirrored here."""
    n, reach = out.size, taps.size - 1
    for k in range(1, reach + 1):
        line[reach - k] = line[reach + mirrored(k, n)]
        line[reach + n - 1 + k] = line[reach + mirrored(n - 1 + k, n)]
    for k in range(1, reach, 3):
        h, h0, h1, h2 = taps[0], taps[k], taps[k + 1], taps[k + 2]
        middle, r, q = line[reach : reach + n], reach + k, reach - k
        a, b, c = line[r : r + n], line[r + 1 : r + 1 + n], line[r + 2 : r + 2 + n]
        d, e, f = line[q : q + n], line[q - 1 : q - 1 + n], line[q - 2 : q - 2 + n]
        if k == 1:
            for j in range(n):
                out[j] = h * middle[j] + h0 * (a[j] + d[j]) + h1 * (b[j] + e[j]) + h2 * (c[j] + f[j])
        else:
            for j in range(n):
                out[j] += h0 * (a[j] + d[j]) + h1 * (b[j] + e[j]) + h2 * (c[j] + f[j])


@njit(fastmath=True)
def across(rows, i, count, taps, out):  # type: ignore[no-untyped-def]
    """out ← the average across rows about row i; row r is kept at rows[r modulo count].

    `rows` hold a whole image of `count` rows instead where count is negative: then they are mirrored.
    """
    n, h = out.size, taps[0]
    for k in range(1, taps.size, 3):
        h0, h1, h2 = taps[k], taps[k + 1], taps[k + 2]
        middle, a, b, c = (
            rows[_at(i, count)],
            rows[_at(i + k, count)],
            rows[_at(i + k + 1, count)],
            rows[_at(i + k + 2, count)],
        )
        d, e, f = rows[_at(i - k, count)], rows[_at(i - k - 1, count)], rows[_at(i - k - 2, count)]
        if k == 1:
            for j in range(n):
                out[j] = h * middle[j] + h0 * (a[j] + d[j]) + h1 * (b[j] + e[j]) + h2 * (c[j] + f[j])
        else:
            for j in range(n):
                out[j] += h0 * (a[j] + d[j]) + h1 * (b[j] + e[j]) + h2 * (c[j] + f[j])


@njit
def _at(i, count):  # type: ignore[no-untyped-def]
    return i % count if count > 0 else mirrored(i, -count)
