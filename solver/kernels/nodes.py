"""Samples among the nodes of a mosaic, which is bilinear between them."""

import numpy as np
from numba import njit

from solver.kernels.barrier import take

PLACES = {"contract", "reassoc", "arcp", "nsz"}  # may be assumed of places: not that they are numbers
WITHIN = 0x7FFFFFFF  # tells the compiler that an index is not negative: it need not look for wrapping


@njit(cache=True, fastmath=PLACES)
def extent(row, column, height, width):  # type: ignore[no-untyped-def]
    """First and last row and column of the places that are at most one image away from the reference.

    Args:
        row: (samples,), pixels of the reference.
        column: (samples,), pixels of the reference.
        height: of the reference, pixels.
        width: the same.
    """
    rows, columns = np.float32(height), np.float32(width)
    top, left, bottom, right = 2 * rows, 2 * columns, -rows, -columns
    for s in range(len(row)):
        r, c = row[s], column[s]
        if r >= -rows and r <= 2 * rows and c >= -columns and c <= 2 * columns:
            top, left, bottom, right = min(top, r), min(left, c), max(bottom, r), max(right, c)
    return np.array([[top, left], [max(top, bottom), max(left, right)]])


@njit(cache=True)
def gather(values, weights, base, keep, shift, y, w, row, column, pixel, first):  # type: ignore[no-untyped-def]
    """The samples of frames that are used and lie in blocks that are kept, one after another.

    Args:
        values: (C, N, H, W), in deviations.
        weights: (N, H, W), 1 / variance, 0 = not used.
        base: (2, H, W), row and column of each pixel.
        keep: (N, blocks down, blocks across), whether a block is kept.
        shift: log₂ of the side of a block.
        y: (samples, C) ← values.
        w: (samples,) ← weights.
        row: (samples,) ← pixels.
        column: (samples,) ← pixels.
        pixel: (samples,) ← number in the frame.
        first: (N + 1,) ← where the samples of each frame begin.
    """
    channels, count, height, width = values.shape
    last_row, last_column = keep.shape[1] - 1, keep.shape[2] - 1  # an odd last pixel has no block of its own
    s = 0
    for k in range(count):
        for i in range(height):
            used, kept = weights[k, i], keep[k, min(i >> shift, last_row)]
            for j in range(width):
                if used[j] > 0.0 and kept[min(j >> shift, last_column)]:
                    w[s] = used[j]
                    row[s] = base[0, i, j]
                    column[s] = base[1, i, j]
                    pixel[s] = i * width + j
                    for h in range(channels):
                        y[s, h] = values[h, k, i, j]
                    s += 1
        first[k + 1] = s


@njit(cache=True, nogil=True)
def accumulate(counter, values, weights, row, column, first, origin, density, sums, others):  # type: ignore[no-untyped-def]
    """Add the samples to the stencil and the right sides; by a team, to each half of the frames its own sums.

    Args:
        counter: (1,), see `kernels.barrier`.
        values: (samples, C), in deviations.
        weights: (samples,), 1 / variance.
        row: (samples,), pixels of the reference.
        column: (samples,), pixels of the reference.
        first: (N + 1,), where the samples of each frame begin.
        origin: (2,), row and column of the first node, pixels.
        density: nodes per pixel.
        sums: (5 + C, rows, columns), stencil and right sides, in place.
        others: (5 + C, rows, columns), those of the second half of the frames, in place; one frame has none.
    """
    half = first[len(first) // 2]  # of one frame, its end
    parts = (slice(0, half), sums), (slice(half, len(weights)), others)
    h = take(counter)
    while h < 2:
        part, into = parts[h]
        _add(values[part], weights[part], row[part], column[part], origin, density, into)
        h = take(counter)


@njit(cache=True, fastmath=PLACES)
def _add(values, weights, row, column, origin, density, sums):  # type: ignore[no-untyped-def]
    """`accumulate` for some samples."""
    rows, columns = sums.shape[1:]
    S, b, channels = sums[:5], sums[5:], len(sums) - 5
    top, left, scale, one = np.float32(origin[0]), np.float32(origin[1]), np.float32(density), np.float32(1.0)
    for s in range(len(weights)):
        r, c = (row[s] - top) * scale, (column[s] - left) * scale
        if not (r >= 0.0 and c >= 0.0 and r < rows - 1 and c < columns - 1):
            continue
        m, n = int(r) & WITHIN, int(c) & WITHIN
        a, d, w = r - np.float32(m), c - np.float32(n), weights[s]
        w00, w01 = (one - a) * (one - d), (one - a) * d
        w10, w11 = a * (one - d), a * d
        for h in range(channels):
            y = w * values[s, h]
            b[h, m, n] += w00 * y
            b[h, m, n + 1] += w01 * y
            b[h, m + 1, n] += w10 * y
            b[h, m + 1, n + 1] += w11 * y
        S[0, m, n] += w * w00 * w00
        S[0, m, n + 1] += w * w01 * w01
        S[0, m + 1, n] += w * w10 * w10
        S[0, m + 1, n + 1] += w * w11 * w11
        S[1, m, n] += w * w00 * w01  # to the right
        S[1, m + 1, n] += w * w10 * w11
        S[2, m, n] += w * w00 * w10  # down
        S[2, m, n + 1] += w * w01 * w11
        S[3, m, n] += w * w00 * w11  # down and right
        S[4, m, n + 1] += w * w01 * w10  # down and left


@njit(cache=True, nogil=True)
def add_misfit(counter, values, weights, row, column, first, origin, density, U, sums, others):  # type: ignore[no-untyped-def]
    """Add the squared residuals of samples against a mosaic, cell by cell; by a team, as `accumulate`.

    Args:
        counter: (1,), see `kernels.barrier`.
        values: (samples, C), in deviations.
        weights: (samples,), 1 / variance.
        row: (samples,), pixels of the reference.
        column: (samples,), pixels of the reference.
        first: (N + 1,), where the samples of each frame begin.
        origin: (2,), row and column of the first node, pixels.
        density: nodes per pixel.
        U: (C, rows, columns), in deviations.
        sums: (2, rows, columns), squares in variances, and how many samples, in place.
        others: (2, rows, columns), those of the second half, in place.
    """
    half = first[len(first) // 2]
    parts = (slice(0, half), sums), (slice(half, len(weights)), others)
    h = take(counter)
    while h < 2:
        part, into = parts[h]
        _add_squares(values[part], weights[part], row[part], column[part], origin, density, U, into)
        h = take(counter)


@njit(cache=True, fastmath=PLACES)
def _add_squares(values, weights, row, column, origin, density, U, sums):  # type: ignore[no-untyped-def]
    """`add_misfit` for some samples."""
    channels, rows, columns = U.shape
    squares, counts = sums
    top, left, scale, one = np.float32(origin[0]), np.float32(origin[1]), np.float32(density), np.float32(1.0)
    share = one / np.float32(channels)
    for s in range(len(weights)):
        r, c = (row[s] - top) * scale, (column[s] - left) * scale
        if not (r >= 0.0 and c >= 0.0 and r < rows - 1 and c < columns - 1):
            continue
        m, n = int(r) & WITHIN, int(c) & WITHIN
        a, d = r - np.float32(m), c - np.float32(n)
        square = np.float32(0.0)
        for h in range(channels):
            up = (one - d) * U[h, m, n] + d * U[h, m, n + 1]
            low = (one - d) * U[h, m + 1, n] + d * U[h, m + 1, n + 1]
            residual = values[s, h] - (one - a) * up - a * low
            square += residual * residual
        squares[m, n] += share * weights[s] * square
        counts[m, n] += one
