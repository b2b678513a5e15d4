"""What a map teaches the next pass, by rows: the weights that the prior keeps, and the map's ties.

Both are averages (`kernels.smoothing`). Rows are made one by one and kept, averaged along, in rings for
as long as they are needed: images that are only averaged are never stored.
"""

import numpy as np
from numba import njit

from solver.kernels.group import COLUMNS, ROWS
from solver.kernels.smoothing import across, along, mirrored

_RING = 16
"""Rows kept, a power of two and more than Gaussians of three taps on a side span."""


@njit(fastmath=True, error_model="numpy")
def _keep(rough, scale, gain, radius, freed):  # type: ignore[no-untyped-def]
    one = rough.dtype.type(1)
    for j in range(rough.size):
        part = rough[j] * scale
        kept = one / (one + part * part)
        radius[j] = gain * kept
        freed[j] = one - kept


@njit(nogil=True, cache=True)
def keep(rank, size, norms, taps, scale, gain, radius, freed):  # type: ignore[no-untyped-def]
    """radius ← gain · ρ, freed ← 1 − ρ with ρ = 1 / (1 + (scale · mean norm)²); by a team.

    Args:
        norms: (rows + 4, columns + 4), padded by 2, in units of λ.
        taps: (taps,), of the mean, symmetric.
        scale: a number.
        gain: a number.
        radius: (rows + 4, columns + 4), padded by 2, whose padding is left alone ←.
        freed: (rows + 4, columns + 4), padded by 2, whose padding is left alone ←.
    """
    rows, n, reach = norms.shape[0] - 4, norms.shape[1] - 4, taps.size - 1
    ring, line, rough = (
        np.zeros((_RING, n), norms.dtype),
        np.zeros(n + 2 * reach, norms.dtype),
        np.zeros(n, norms.dtype),
    )
    top, end = rank * rows // size, (rank + 1) * rows // size
    for row in range(top - reach, end + reach):
        line[reach : reach + n] = norms[mirrored(row, rows) + 2, 2 : 2 + n]
        along(line, taps, ring[row % _RING])
        i = row - reach
        if i >= top:
            across(ring, i, _RING, taps, rough)
            _keep(rough, scale, gain, radius[i + 2, 2 : 2 + n], freed[i + 2, 2 : 2 + n])


@njit(fastmath=True)
def _add_difference(k, i, x, slope, out):  # type: ignore[no-untyped-def]
    """out += (G x − s)² of difference k at row i, one channel."""
    n = out.size
    down, right = x.dtype.type(ROWS[k]), x.dtype.type(COLUMNS[k])
    here, there = x[i, 2 : 2 + n], x[i + ROWS[k], 2 + COLUMNS[k] : 2 + COLUMNS[k] + n]
    fall, run, target = slope[0, i, 2 : 2 + n], slope[1, i, 2 : 2 + n], out[:n]
    for j in range(n):
        found = here[j] - there[j] + down * fall[j] + right * run[j]
        target[j] += found * found


@njit(fastmath=True)
def _size(weight, line):  # type: ignore[no-untyped-def]
    for j in range(line.size):
        line[j] = np.sqrt(weight[j] * line[j])


@njit(fastmath=True, error_model="numpy")
def _loosen(mean, freed, inverse, out):  # type: ignore[no-untyped-def]
    """out = 255 · freed / (1 + (mean · inverse)²)², rounded; one row."""
    n = mean.size
    s, f, target, one = mean[:n], freed[:n], out[:n], mean.dtype.type(1)
    most, half = mean.dtype.type(255), mean.dtype.type(0.5)
    for j in range(n):
        loose = one + (s[j] * inverse) * (s[j] * inverse)
        target[j] = np.uint8(np.int32(most * f[j] / (loose * loose) + half))


@njit(nogil=True, cache=True)
def tie(rank, size, x, slope, up, taps, freed, inverse, levels):  # type: ignore[no-untyped-def]
    """levels ← 255 · freed / (1 + (inverse · mean |G x − s|)²)²; by a team.

    Args:
        x: (C, rows + 4, columns + 4), a map padded by 2, in units of λ.
        slope: (C, 2, rows + 4, columns + 4), the gradient that is foretold, by row and column, or (C, 2, 0,
            0) = level.
        up: (3, 6, columns), of `kernels.group.tables`.
        taps: (taps,), of the mean, symmetric.
        freed: (rows + 4, columns + 4), padded by 2, 1 − ρ.
        inverse: 1 / δ.
        levels: (6, rows + 4, columns + 4), bytes, 0 where the difference leaves the image ←.
    """
    rows, n, reach = x.shape[1] - 4, x.shape[2] - 4, taps.size - 1
    rings, line, mean = (
        np.zeros((6, _RING, n), x.dtype),
        np.zeros(n + 2 * reach, x.dtype),
        np.zeros(n, x.dtype),
    )
    top, end = rank * rows // size, (rank + 1) * rows // size
    for row in range(top - reach, end + reach):
        source, i, own = mirrored(row, rows), row - reach, line[reach : reach + n]
        weights = up[max(0, source + 3 - rows)]
        for k in range(6):
            own[:] = 0
            for c in range(x.shape[0]):
                _add_difference(k, source + 2, x[c], slope[c], own)
            _size(weights[k], own)
            along(line, taps, rings[k, row % _RING])
            if i >= top:
                target, first = levels[k, i + 2], min(max(0, -COLUMNS[k]), n)
                last = max(first, n - max(0, COLUMNS[k])) if i + ROWS[k] < rows else first
                across(rings[k], i, _RING, taps, mean)
                _loosen(
                    mean[first:last],
                    freed[i + 2, 2 + first : 2 + last],
                    inverse,
                    target[2 + first : 2 + last],
                )
                target[: 2 + first] = 0
                target[2 + last :] = 0
    for k in range(6):
        if rank == 0:
            levels[k, :2] = 0
        if rank == size - 1:
            levels[k, rows + 2 :] = 0
