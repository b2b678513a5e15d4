"""A slope for every pixel, of the windows about it and beside it that agree with its own rise."""

import numpy as np
from numba import njit

from solver.kernels.rises import divide, subtract
from solver.kernels.view import view


@njit
def _repeat_ends(lines, away):  # type: ignore[no-untyped-def]
    """The ends of (2, n + 2 away) are those of what lies between."""
    for axis in range(2):
        line = lines[axis]
        line[:away] = line[away]
        line[line.size - away :] = line[line.size - away - 1]


@njit(fastmath=True, error_model="numpy")
def _hear(rises, by_row, by_column, measure, scale, sums):  # type: ignore[no-untyped-def]
    """sums (3, n) += 1 / (1 + scale · (rise − slope)²)², and both slopes, in `measure`, times it."""
    down, right, total, first, second = rises[0], rises[1], sums[0], sums[1], sums[2]
    one = sums.dtype.type(1)
    for j in range(down.size):
        p, q = measure[j] * by_row[j], measure[j] * by_column[j]
        u, v = down[j] - p, right[j] - q
        part = one + scale * (u * u + v * v)
        share = one / (part * part)
        total[j] += share
        first[j] += share * p
        second[j] += share * q


@njit(fastmath=True, error_model="numpy")
def _curve(before, here, after, measure, square, total):  # type: ignore[no-untyped-def]
    """square += the squared second difference of slopes along one axis, total += it; both in `measure`."""
    two = square.dtype.type(2)
    for j in range(square.size):
        d = measure[j] * (before[j] + after[j] - two * here[j])
        square[j] += d * d
        total[j] += d


@njit(fastmath=True, error_model="numpy")
def _tell(square, noise, light, trust):  # type: ignore[no-untyped-def]
    """trust ← the part of the second differences that is not noise, noise / light, times it."""
    none, tiny = trust.dtype.type(0), trust.dtype.type(1e-30)
    for j in range(trust.size):
        trust[j] *= max(none, square[j] - noise / (light[j] + tiny)) / (square[j] + tiny)


@njit(fastmath=True)
def _sharpen(trust, slope, measure, curve, part, mean):  # type: ignore[no-untyped-def]
    """mean ← as far as that is to be trusted, the slope less `part` of its curve."""
    for j in range(mean.size):
        mean[j] += trust[j] * (measure[j] * slope[j] - part * curve[j] - mean[j])


@njit(nogil=True, cache=True)
def bring(rank, size, near, measure, share, out):  # type: ignore[no-untyped-def]
    """out (2, rows + 4, columns + 4) ← by so much of the way, share, nearer to other slopes; by a team.

    Args:
        near: (2, rows + 4, columns + 4), in the measure per pixel.
        measure: (rows + 4, columns + 4), as in `choose`.
        share: (rows, columns), 0 to 1.
        out: in the map's unit per pixel.
    """
    rows, n = share.shape
    none = np.zeros(n, out.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        own = view(measure, (row + 2,), 2, n)
        for axis in range(2):
            there, here = view(near, (axis, row + 2), 2, n), view(out, (axis, row + 2), 2, n)
            _sharpen(share[row], there, own, none, out.dtype.type(0), here)


@njit(nogil=True, cache=True)
def choose(  # type: ignore[no-untyped-def]
    rank, size, x, slopes, measure, light, noise, away, scale, part, out, square
):
    """out ← a slope of those here and `away` in each direction; by a team.

    Their mean by how well they agree with the pixel's own rise, or, as far as the window about the pixel
    agrees and the second differences of the slopes exceed their noise, the slope here less `part` of the sum
    of these.

    Args:
        x: (rows + 4, columns + 4), a map padded by 2, any unit, of which each pixel's own rise is taken.
        slopes: (2, rows + 4, columns + 4), its mean rise by row and by column, in the measure per pixel.
        measure: (rows + 4, columns + 4), in which slopes of one surface are the same.
        light: (rows + 4, columns + 4), any unit.
        noise: sum of the variances of all second differences of slopes at light 1, in the map's unit².
        away: pixels.
        scale: 1 / edge²; a slope counts 1 / (1 + scale · (rise − slope)²)².
        part: a number.
        out: (2, rows + 4, columns + 4), in the map's unit per pixel, 0 in the padding.
        square: (rows, columns) ←, the squared second differences of the slopes, in the map's unit per pixel.
    """
    rows, n, kind = x.shape[0] - 4, x.shape[1] - 4, x.dtype.type
    rises, sums = np.zeros((2, n), x.dtype), np.zeros((3, n), x.dtype)
    trust, curves = np.zeros(n, x.dtype), np.zeros((2, n), x.dtype)
    lines = np.zeros((2, n + 2 * away), x.dtype)
    for row in range(rank * rows // size, (rank + 1) * rows // size):
        i, last = min(row, max(0, rows - 2)), max(n - 1, 1)
        if rows > 1:
            subtract(x[i + 3, 2 : 2 + n], x[i + 2, 2 : 2 + n], rises[0])
        subtract(x[row + 2, 3 : 2 + n], x[row + 2, 2 : 1 + n], rises[1, : n - 1])
        rises[1, last:] = rises[1, last - 1]
        sums[:] = 0
        own = view(measure, (row + 2,), 2, n)
        for down in (0, -away, away):
            there = min(max(row + down, 0), rows - 1) + 2
            by_row, by_column = view(slopes, (0, there), 2, n), view(slopes, (1, there), 2, n)
            _hear(rises, by_row, by_column, own, kind(scale), sums)
            if down == 0:
                trust[:] = sums[0]
        for axis in range(2):
            lines[axis, away : away + n] = slopes[axis, row + 2, 2 : 2 + n]
        _repeat_ends(lines, away)
        for by in (0, 2 * away):
            _hear(rises, lines[0, by : by + n], lines[1, by : by + n], own, kind(scale), sums)
        bent = square[row]
        bent[:] = 0
        curves[:] = 0
        above, below = max(row - away, 0) + 2, min(row + away, rows - 1) + 2
        for axis in range(2):
            here, line = view(slopes, (axis, row + 2), 2, n), lines[axis]
            up, end = view(slopes, (axis, above), 2, n), view(slopes, (axis, below), 2, n)
            _curve(up, here, end, own, bent, curves[axis])
            _curve(line[:n], here, line[2 * away :], own, bent, curves[axis])
        _tell(bent, kind(noise), view(light, (row + 2,), 2, n), trust)
        for axis in range(2):
            target = out[axis, row + 2]
            target[:2] = 0
            target[2 + n :] = 0
            here, found = view(slopes, (axis, row + 2), 2, n), target[2 : 2 + n]
            divide(sums[1 + axis], sums[0], kind(0), found)
            _sharpen(trust, here, own, curves[axis], kind(part), found)
    for axis in range(2):
        if rank == 0:
            out[axis, :2] = 0
        if rank == size - 1:
            out[axis, rows + 2 :] = 0
