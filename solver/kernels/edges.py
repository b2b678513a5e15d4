"""Where an image is steep, node by node."""

import numpy as np
from numba import njit

UNSEEN, FLAT, STEEP = 0, 1, 2


@njit(cache=True)
def look_up(kind, first, pixel, row, column, row0, column0, density, blocks):  # type: ignore[no-untyped-def]
    """blocks ← whether the node next to each sample is steep.

    Args:
        kind: (rows, columns), of `classify`.
        first: (N + 1,), where the samples of each frame begin.
        pixel: (samples,), the pixel of its frame that a sample is.
        row: (samples,), pixels of the reference.
        column: (samples,), pixels of the reference.
        row0: of the first node, pixels.
        column0: the same.
        density: nodes per pixel.
        blocks: (N, H · W), in place; what is no sample is left alone.
    """
    rows, columns = kind.shape
    top, left, scale, half = np.float32(row0), np.float32(column0), np.float32(density), np.float32(0.5)
    for k in range(len(blocks)):
        for s in range(first[k], first[k + 1]):
            r, c = (row[s] - top) * scale + half, (column[s] - left) * scale + half
            inside = r >= 0.0 and c >= 0.0 and r < rows and c < columns
            blocks[k, pixel[s]] = inside and kind[int(r), int(c)] == STEEP


@njit(cache=True, fastmath=True)
def steepness(image, covered, square):  # type: ignore[no-untyped-def]
    """square ← |∇U|² of central differences, four times, where all nodes around are covered, else −1.

    Args:
        image: (C, rows, columns), in deviations.
        covered: (rows, columns), whether there are samples.
        square: (rows, columns), −1 at the border.
    """
    channels, rows, columns = image.shape
    line, outside = np.empty(columns, np.bool_), np.float32(-1.0)
    for i in range(1, rows - 1):
        out = square[i, 1:-1]
        out[:] = 0
        for h in range(channels):
            above, below = image[h, i - 1, 1:-1], image[h, i + 1, 1:-1]
            before, after = image[h, i, :-2], image[h, i, 2:]
            for j in range(columns - 2):
                down, right = below[j] - above[j], after[j] - before[j]
                out[j] += down * down + right * right
        up, own, low = covered[i - 1], covered[i], covered[i + 1]
        for j in range(columns):
            line[j] = up[j] & own[j] & low[j]
        west, centre, east = line[:-2], line[1:-1], line[2:]
        for j in range(columns - 2):
            out[j] = out[j] if west[j] & centre[j] & east[j] else outside


@njit(cache=True)
def classify(square, limit, covered, kind):  # type: ignore[no-untyped-def]
    """kind ← STEEP where a node at most two rows and columns away reaches the limit.

    Args:
        square: (rows, columns), of `steepness`.
        limit: from which on a node is steep.
        covered: (rows, columns), whether there are samples.
        kind: (rows, columns) ← UNSEEN, FLAT or STEEP.
    """
    rows, columns = square.shape
    least = np.float32(limit)
    across = np.zeros((rows, columns), np.uint8)
    line = np.zeros(columns + 4, np.uint8)
    for i in range(rows):
        own, into, out = square[i], line[2:-2], across[i]
        for j in range(columns):
            into[j] = own[j] >= least
        a, b, c, d, e = line[:-4], line[1:-3], line[2:-2], line[3:-1], line[4:]
        for j in range(columns):
            out[j] = a[j] | b[j] | c[j] | d[j] | e[j]
    for i in range(rows):
        seen, out = covered[i], kind[i]
        out[:] = 0
        for near in range(max(i - 2, 0), min(i + 3, rows)):
            steep = across[near]
            for j in range(columns):
                out[j] |= steep[j]
        for j in range(columns):
            out[j] = (out[j] + np.uint8(1)) * np.uint8(seen[j])  # UNSEEN, FLAT and STEEP are 0, 1 and 2
