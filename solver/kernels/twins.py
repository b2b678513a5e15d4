"""Pairs of samples that look at almost the same place; see `solver.preparation.scatter`."""

import numpy as np
from numba import njit

from solver.kernels.medians import find


@njit(nogil=True, cache=True)
def compare(rank, size, distance, positions, ambiguity, least, share, differences):  # type: ignore[no-untyped-def]
    """differences (H, W) ← a quantile of |y − y'|, y of the samples on a pixel and y' of the nearest to each.

    0 where fewer than `least` know. Of two of a frame on one pixel the later counts. By a team, of which each
    looks through all samples for those on its rows.

    Args:
        distance: (N, H, W), any unit, NaN = not used.
        positions: (N, H, W, 2), pixels of frame 0.
        ambiguity: the ambiguity range, whole ones of which are taken off.
        least: a number of samples.
        share: of the differences, how many are smaller.
        differences: (H, W), in distance's unit ←.
    """
    frames, rows, columns = distance.shape
    first, last = rank * rows // size, (rank + 1) * rows // size
    found = np.full((last - first, columns, 3, frames), np.float32(np.nan), np.float32)
    places = np.empty(columns, np.int32)
    for k in range(frames):
        for i in range(rows):
            find(positions[k, i], rows, columns, places)
            for j in range(columns):
                place, y = places[j], distance[k, i, j]
                if first * columns <= place < last * columns and y == y:
                    into = found[place // columns - first, place % columns]
                    into[0, k], into[1, k], into[2, k] = y, positions[k, i, j, 0], positions[k, i, j, 1]
    apart = np.empty(frames, np.float32)
    for i in range(first, last):
        for j in range(columns):
            count = _differences(found[i - first, j], ambiguity, apart)
            differences[i, j] = _quantile(apart[:count], share) if count >= least else np.float32(0)


@njit
def _quantile(values, share):  # type: ignore[no-untyped-def]
    """Of values (n,), linear between the middles of the ranks; sorts them."""
    values.sort()
    rank = max(np.float32(share * values.size - 0.5), np.float32(0))
    low = int(rank)
    high = min(low + 1, values.size - 1)
    return values[low] + (rank - np.float32(low)) * (values[high] - values[low])


@njit
def _differences(samples, ambiguity, apart):  # type: ignore[no-untyped-def]
    """apart ← |y − y'| of the samples (3, N), y and the two coordinates, that are known; how many."""
    count = 0
    for k in range(samples.shape[1]):
        if samples[0, k] == samples[0, k]:
            samples[:, count] = samples[:, k]
            count += 1
    y, u, v, n = samples[0, :count], samples[1, :count], samples[2, :count], np.uintp(count)
    for k in range(n):
        nearest, step = np.float32(np.inf), np.float32(0)
        for other in range(n):
            square = (u[other] - u[k]) ** 2 + (v[other] - v[k]) ** 2
            closer = (square < nearest) & (other != k)
            nearest, step = (square if closer else nearest), (y[other] - y[k] if closer else step)
        apart[k] = abs(step - ambiguity * np.round(step / ambiguity))
    return count


@njit(nogil=True, cache=True)
def assign(rank, size, scatter, positions, usual, sigma):  # type: ignore[no-untyped-def]
    """sigma (N, H, W) ← the deviation (H, W) on the pixel that a sample falls on; by a team.

    Args:
        scatter: (H, W), deviations, any unit, 0 = the usual one.
        positions: (N, H, W, 2), pixels of frame 0.
        usual: deviation, also that of samples off the grid.
        sigma: (N, H, W), in scatter's unit ←.
    """
    frames, rows, columns = sigma.shape
    on_grid, places = scatter.reshape(-1), np.empty(columns, np.int32)
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        find(positions[k, i], rows, columns, places)
        for j in range(columns):
            known = places[j] >= 0 and on_grid[places[j]] > 0
            sigma[k, i, j] = on_grid[places[j]] if known else usual
