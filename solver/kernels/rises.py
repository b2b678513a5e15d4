"""The slope of a map, by rows: every pixel's rise, averaged over its surroundings at half the resolution.

Rises are divided by a `measure` of their own pixel before they are averaged.
"""

import numpy as np
from numba import njit

from solver.kernels.smoothing import across, along
from solver.kernels.view import view


@njit(fastmath=True)
def subtract(a, b, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = a[j] - b[j]


@njit(fastmath=True, error_model="numpy")
def _say(down, right, before, i, scale, out):  # type: ignore[no-untyped-def]
    """out ← 1 / (1 + scale · (rises − those before)²)², rises (C, n), before (C, 2, …, n + 4) at row i."""
    one = out.dtype.type(1)
    out[:] = 0
    for c in range(down.shape[0]):
        a, b = down[c], right[c]
        p, q = view(before, (c, 0, i), 2, out.size), view(before, (c, 1, i), 2, out.size)
        for j in range(out.size):
            u, v = a[j] - p[j], b[j] - q[j]
            out[j] += u * u + v * v
    for j in range(out.size):
        part = one + scale * out[j]
        out[j] = one / (part * part)


@njit(fastmath=True)
def _vote(say, rise, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] += say[j] * rise[j]


@njit(fastmath=True)
def _pairs(line, out):  # type: ignore[no-untyped-def]
    """out ← sums of two neighbours; the last one of an odd number is alone."""
    for j in range(line.size // 2):
        out[j] = line[2 * j] + line[2 * j + 1]
    if line.size % 2:
        out[line.size // 2] = line[line.size - 1]


@njit(nogil=True, cache=True)
def votes(rank, size, x, before, measure, weight, scale, taps, out):  # type: ignore[no-untyped-def]
    """out (1 + 2 C, half rows, half columns) ← each pixel's say, and its rise by row and by column times it.

    Sums over 2 × 2 pixels, averaged along rows; by a team.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, any unit; the last row and column repeat the rise
            before them.
        before: (C, 2, rows + 4, columns + 4), the gradient that was found before, by row and column.
        measure: (rows + 4, columns + 4), padded by 2.
        weight: (rows + 4, columns + 4), padded by 2, each pixel's say.
        scale: 1 / edge²; the say is weight / (1 + scale · (rises − before)²)².
        taps: (taps,), of the mean along rows, symmetric.
        out: (1 + 2 C, half rows, half columns).
    """
    channels, rows, n = x.shape[0], x.shape[1] - 4, x.shape[2] - 4
    half_rows, half, reach = out.shape[1], out.shape[2], taps.size - 1
    down, right = np.zeros((channels, n), x.dtype), np.zeros((channels, n), x.dtype)
    say, sums, line = (
        np.zeros(n, x.dtype),
        np.zeros((out.shape[0], n), x.dtype),
        np.zeros(half + 2 * reach, x.dtype),
    )
    ones = np.ones(n, x.dtype)
    for pair in range(rank * half_rows // size, (rank + 1) * half_rows // size):
        sums[:] = 0
        for row in range(2 * pair, min(2 * pair + 2, rows)):
            # In an image of one row or column nothing rises along it.
            i, last = min(row, max(0, rows - 2)), max(n - 1, 1)
            for c in range(channels):
                if rows > 1:
                    subtract(x[c, i + 3, 2 : 2 + n], x[c, i + 2, 2 : 2 + n], down[c])
                subtract(x[c, row + 2, 3 : 2 + n], x[c, row + 2, 2 : 1 + n], right[c, : n - 1])
                right[c, last:] = right[c, last - 1]
            _say(down, right, before, row + 2, scale, say)
            say *= view(weight, (row + 2,), 2, n)
            _vote(say, ones, sums[0])
            say /= view(measure, (row + 2,), 2, n)
            for c in range(channels):
                _vote(say, down[c], sums[1 + 2 * c])
                _vote(say, right[c], sums[2 + 2 * c])
        for number in range(out.shape[0]):
            _pairs(sums[number], line[reach : reach + half])
            along(line, taps, out[number, pair])


@njit(fastmath=True)
def _between(a, b, near, line, out):  # type: ignore[no-untyped-def]
    """out (n,) ← near · a + (1 − near) · b, half rows, at twice the resolution."""
    half, far = a.size, a.dtype.type(1) - near
    middle = line[1 : 1 + half]
    for j in range(half):
        middle[j] = near * a[j] + far * b[j]
    line[0], line[half + 1] = line[1], line[half]
    most, least = a.dtype.type(0.75), a.dtype.type(0.25)
    for j in range(out.size // 2):
        out[2 * j] = most * line[j + 1] + least * line[j]
        out[2 * j + 1] = most * line[j + 1] + least * line[j + 2]
    if out.size % 2:
        out[out.size - 1] = most * line[half] + least * line[half - 1]


@njit(fastmath=True, error_model="numpy")
def divide(a, b, tiny, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        out[j] = a[j] / (b[j] + tiny)


@njit(nogil=True, cache=True)
def slopes(rank, size, votes, taps, tiny, out):  # type: ignore[no-untyped-def]
    """out (C, 2, rows + 4, columns + 4) ← the mean rise by row and by column, 0 in the padding; by a team.

    Args:
        votes: (1 + 2 C, half rows, half columns), as `votes` leaves them, still to be averaged across rows.
        taps: (taps,), of the mean, symmetric.
        tiny: more than no say at all.
        out: (C, 2, rows + 4, columns + 4), in the measure per pixel.
    """
    channels, rows, n = out.shape[0], out.shape[2] - 4, out.shape[3] - 4
    images, half_rows, half = votes.shape
    kind = votes.dtype.type
    near = np.zeros((2, images, half), votes.dtype)
    line, total, vote = np.zeros(half + 2, votes.dtype), np.zeros(n, votes.dtype), np.zeros(n, votes.dtype)
    top, end = rank * half_rows // size, (rank + 1) * half_rows // size
    ready = top - 2
    for row in range(2 * top, min(2 * end, rows)):
        # Half rows lie between pairs of rows: row i at ½ i − ¼.
        first = (row + 1) // 2 - 1
        while ready < first + 1:
            ready += 1
            for number in range(images):
                across(
                    votes[number],
                    min(max(ready, 0), half_rows - 1),
                    -half_rows,
                    taps,
                    near[ready % 2, number],
                )
        share = kind(0.75) if row % 2 else kind(0.25)
        upper, lower = near[first % 2], near[(first + 1) % 2]
        _between(upper[0], lower[0], share, line, total)
        for c in range(channels):
            for axis in range(2):
                target = out[c, axis, row + 2]
                _between(upper[1 + 2 * c + axis], lower[1 + 2 * c + axis], share, line, vote)
                divide(vote, total, tiny, target[2 : 2 + n])
                target[:2] = 0
                target[2 + n :] = 0
    for c in range(channels):
        for axis in range(2):
            if rank == 0:
                out[c, axis, :2] = 0
            if rank == size - 1:
                out[c, axis, rows + 2 :] = 0
