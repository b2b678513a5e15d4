"""The deviation map: how steep or bent a map is, and one deviation per pixel from that and the samples."""

import numpy as np
from numba import njit

from solver.kernels.elementary import exponential
from solver.kernels.group import COLUMNS, ROWS


@njit(fastmath=True)
def _steepness(x, i, out):  # type: ignore[no-untyped-def]
    """out ← ‖∇x‖₂ along row i of (rows, columns), the differences of `solver.optimisation.prior`."""
    rows, columns = x.shape
    out[:] = 0
    for k in range(6):
        down, right = ROWS[k], COLUMNS[k]
        if i + down >= rows or abs(right) >= columns:
            continue
        first, last = max(0, -right), columns - max(0, right)
        here, there = x[i, first:last], x[i + down, first + right : last + right]
        square, share = out[first:last], x.dtype.type(1 / (down * down + right * right))
        for j in range(last - first):
            square[j] += share * (here[j] - there[j]) * (here[j] - there[j])
    for j in range(columns):
        out[j] = np.sqrt(out[j])


@njit(fastmath=True)
def _bend(x, i, out):  # type: ignore[no-untyped-def]
    """out ← the root of the squared second differences along rows, columns and diagonals, 0 at borders."""
    rows, columns = x.shape
    out[:] = 0
    for r, c in ((0, 1), (1, 0), (1, 1), (1, -1)):
        if i < r or i + r >= rows or columns < 3:
            continue
        side = abs(c)
        n, share, two = columns - 2 * side, x.dtype.type(1 / (r * r + c * c)), x.dtype.type(2)
        before, here, after = x[i - r, side - c :], x[i, side:], x[i + r, side + c :]
        square = out[side:]
        for j in range(n):
            d = before[j] - two * here[j] + after[j]
            square[j] += share * d * d
    for j in range(columns):
        out[j] = np.sqrt(out[j])


@njit
def _reflected(i, n):  # type: ignore[no-untyped-def]
    """The one of n rows that stands for row i; the border row is repeated."""
    i = i % (2 * n)
    return i if i < n else 2 * n - 1 - i


@njit(fastmath=True)
def _window(line, factor, out):  # type: ignore[no-untyped-def]
    """out ← sums of `factor` neighbours along a line, whose entries begin at factor // 2."""
    n, before = out.size, factor // 2
    for k in range(1, factor + 1):
        if k <= before:
            line[before - k] = line[before + _reflected(-k, n)]
        if k < factor - before:
            line[before + n - 1 + k] = line[before + _reflected(n - 1 + k, n)]
    out[:] = 0
    for k in range(factor):
        moved = line[k : k + n]
        for j in range(n):
            out[j] += moved[j]


@njit(fastmath=True)
def _add_rows(ring, out):  # type: ignore[no-untyped-def]
    out[:] = 0
    for k in range(len(ring)):
        row = ring[k]
        for j in range(out.size):
            out[j] += row[j]


@njit(fastmath={"contract", "arcp", "reassoc", "nsz"}, error_model="numpy")
def _deviate(samples, steep, noise, least, shift, share, out):  # type: ignore[no-untyped-def]
    for j in range(out.size):
        slip = shift * share * steep[j]
        out[j] = np.sqrt(noise * noise / max(samples[j] * share, least) + slip * slip)


@njit(nogil=True, cache=True)
def combine(rank, size, x, precision, factor, noise, least, shift, ramps, out):  # type: ignore[no-untyped-def]
    """out ← √(noise² / samples + (shift · steepness)²), each a mean over factor × factor pixels; by a team.

    Args:
        x: (rows, columns), the fused map, any unit.
        precision: (rows, columns), of the samples on each pixel, in 1 / noise².
        factor: β.
        noise: deviation of a sample.
        least: as which fewer samples count.
        shift: error of place, pixels.
        ramps: whether ramps are no steeper than what is level, but only what bends.
        out: (rows, columns), in the map's unit.
    """
    rows, n = x.shape
    before, share = factor // 2, x.dtype.type(1 / factor**2)
    rings, line = np.zeros((2, factor, n), x.dtype), np.zeros(n + factor, x.dtype)
    samples, steep, own = np.zeros(n, x.dtype), np.zeros(n, x.dtype), line[before : before + n]
    top, end = rank * rows // size, (rank + 1) * rows // size
    for row in range(top - before, end + factor - 1 - before):
        source = _reflected(row, rows)
        for j in range(n):
            own[j] = precision[source, j]
        _window(line, factor, rings[0, row % factor])
        if ramps:
            _bend(x, source, own)
        else:
            _steepness(x, source, own)
        _window(line, factor, rings[1, row % factor])
        i = row - (factor - 1 - before)
        if i >= top:
            _add_rows(rings[0], samples)
            _add_rows(rings[1], steep)
            _deviate(samples, steep, noise, least, shift, share, out[i])


@njit(nogil=True, fastmath={"contract", "arcp", "reassoc", "nsz"}, cache=True)
def fade(rank, size, away, scale, most, deviation, distance):  # type: ignore[no-untyped-def]
    """Double the deviation with each unit that the nearest sample is away; images (rows, columns); by a team.

    Both it and distance become NaN further away than `most` units; away is in pixels, `scale` times as many
    units.

    Args:
        away: (rows, columns), pixels.
        scale: units per pixel.
        most: units.
        deviation: (rows, columns), any unit, in place.
        distance: (rows, columns), any unit, in place.
    """
    rows, columns = distance.shape
    double, nothing = np.float32(np.log(2.0)), np.float32(np.nan)
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        a, s, d = away[i], deviation[i], distance[i]
        for j in range(columns):
            units = a[j] * scale
            s[j] *= exponential(double * min(units, np.float32(20)))
            s[j] = s[j] if units <= most else nothing
            d[j] = d[j] if units <= most else nothing
