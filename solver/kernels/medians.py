"""Which samples agree with the other frames; see `solver.preparation.consensus`."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def align(rank, size, distance, sigma, most, positions, beyond, planes):  # type: ignore[no-untyped-def]
    """planes (N, H + 2b, W + 2b) ← the samples (N, H, W) by the pixel that they fall on, NaN where none do.

    Samples that are not valid or deviate by more than `most` have no vote: ∞. Of two of a frame on one pixel
    the later one that has a vote counts. By a team, as all kernels here.

    Args:
        distance: (N, H, W), any unit.
        sigma: (N, H, W), deviations in distance's unit.
        most: deviation.
        positions: (N, H, W, 2), pixels of frame 0.
        beyond: b, pixels that the grid is continued by on every side.
        planes: in distance's unit ←.
    """
    frames, rows, columns = distance.shape
    height, width, middle = planes.shape[1], planes.shape[2], np.float32(beyond + 0.5)
    for k in range(rank * frames // size, (rank + 1) * frames // size):
        planes[k] = np.float32(np.nan)
        for i in range(rows):
            for j in range(columns):
                u, v = positions[k, i, j, 0] + middle, positions[k, i, j, 1] + middle
                if 0 <= u < height and 0 <= v < width:  # also refuses NaN
                    y, row, column = distance[k, i, j], np.int64(u), np.int64(v)
                    if sigma[k, i, j] <= most and y == y:
                        planes[k, row, column] = y
                    elif not np.isfinite(planes[k, row, column]):
                        planes[k, row, column] = np.float32(np.inf)


@njit(nogil=True, cache=True)
def medians(rank, size, planes, least, low, high):  # type: ignore[no-untyped-def]
    """low and high (H, W) ← the medians of the frames (N, H, W) that have a vote.

    Of an even number they are the two in the middle: where votes are even, both sides are right. Where fewer
    than `least` vote, anything may be: −∞ and ∞. Where fewer look at all, nothing is asked: ∞ and −∞.

    Rows are sorted as far as the middle, all columns at once.

    Args:
        planes: (N, H, W), of `align`.
        least: a number of frames.
        low: (H, W), any unit ←.
        high: (H, W), any unit ←.
    """
    frames, rows, columns = planes.shape
    ranked, counts = np.empty((frames, columns), np.float32), np.empty((2, columns), np.int64)
    (looks, votes), never = counts, np.float32(np.inf)
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        counts[:] = 0
        for k in range(frames):
            for j in range(columns):
                value = planes[k, i, j]
                looks[j] += value == value
                votes[j] += value < never
                ranked[k, j] = value if value == value else never
        for first in range(frames // 2 + 1):
            for k in range(frames - 1, first, -1):
                _order(ranked[k - 1], ranked[k])
        for j in range(columns):
            known, none = votes[j] >= least, never if looks[j] < least else -never
            low[i, j] = ranked[max(votes[j] - 1, 0) // 2, j] if known else none
            high[i, j] = ranked[votes[j] // 2, j] if known else -none


@njit
def _order(upper, lower):  # type: ignore[no-untyped-def]
    """Exchange what of the lower row is less than what stands above it."""
    n = upper.size
    a, b = upper[:n], lower[:n]
    for j in range(n):
        x, y = a[j], b[j]
        swap = y < x
        a[j], b[j] = (y if swap else x), (x if swap else y)


@njit(nogil=True, cache=True, error_model="numpy")
def judge(rank, size, measured, sigma, positions, bounds, beyond, slack, ambiguity, agrees, against):  # type: ignore[no-untyped-def]
    """agrees (N, H, W) ← whether each sample lies near enough to what the frames around it say.

    Args:
        measured: (N, H, W), any unit, NaN agrees.
        sigma: (N, H, W), its deviation.
        positions: (N, H, W, 2), pixels of frame 0.
        bounds: two of (H + 2b, W + 2b), least and greatest distance around, ∓∞ = unknown: all agrees.
        beyond: b, pixels that the grid is continued by on every side; farther out all agrees.
        slack: in units of high − low from the middle, in deviations, in units of the middle.
        ambiguity: the ambiguity range, whole ones of which do not count; 0 = they do.
        agrees: (N, H, W) ←.
        against: (N, H) ← samples of a row that do not agree.
    """
    frames, rows, columns = measured.shape
    low, high = bounds[0].reshape(-1), bounds[1].reshape(-1)
    places, grid = np.empty(columns, np.int32), bounds[0].shape
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        find(positions[k, i], grid[0], grid[1], places, beyond)
        own = measured[k, i], sigma[k, i]
        against[k, i] = _judge_row(own, places, low, high, slack, ambiguity, agrees[k, i])


@njit
def find(positions, rows, columns, places, beyond=0):  # type: ignore[no-untyped-def]
    """places ← the flat number of the pixel of the grid under each sample of a row, −1 outside.

    Args:
        positions: (W, 2), pixels of frame 0, contiguous.
        rows, columns: of the grid, `beyond` pixels that it is continued by on every side included.
    """
    middle, none = np.float32(beyond + 0.5), np.float32(0)
    height, width, across = np.float32(rows), np.float32(columns), np.int32(columns)
    flat = positions.reshape(-1)
    for j in range(places.size):
        u, v = flat[np.uintp(2 * j)] + middle, flat[np.uintp(2 * j + 1)] + middle
        inside = (u >= none) & (u < height) & (v >= none) & (v < width)  # also refuses NaN
        # Bounded, so that the loop is free of branches.
        place = np.int32(min(max(u, none), height)) * across + np.int32(min(max(v, none), width))
        places[j] = place if inside else np.int32(-1)


@njit(error_model="numpy")
def _judge_row(own, places, low, high, slack, ambiguity, agrees):  # type: ignore[no-untyped-def]
    """`judge` for one row; how many samples of it do not agree."""
    (measured, sigma), n = own, places.size
    ds, deviations, verdicts = measured[:n], sigma[:n], agrees[:n]
    half, count, never = np.float32(0.5), 0, np.float32(np.inf)
    for j in range(n):
        place = np.uintp(max(places[j], 0))
        least, most = low[place], high[place]
        middle = half * (least + most)
        away = abs(ds[j] - middle)
        if ambiguity > 0:
            away = abs(away - ambiguity * np.round(away / ambiguity))
        allowed = slack[0] * (most - least) + slack[1] * deviations[j] + slack[2] * abs(middle)
        agree = not away > (allowed if places[j] >= 0 else never)  # NaN agrees
        verdicts[j] = agree
        count += not agree
    return count


@njit(nogil=True, cache=True)
def changes(rank, size, measured, distance, agrees, out):  # type: ignore[no-untyped-def]
    """out (N, H) ← how many samples of each row agree though distance (N, H, W) is NaN, or the other way.

    Args:
        measured: (N, H, W), any unit.
        distance: (N, H, W), any unit.
        agrees: (N, H, W).
        out: (N, H).
    """
    frames, rows, columns = measured.shape
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        d, used, verdicts, count = measured[k, i], distance[k, i], agrees[k, i], 0
        for j in range(columns):
            count += (d[j] == d[j]) & (verdicts[j] != (used[j] == used[j]))
        out[k, i] = count


@njit(nogil=True, cache=True)
def limit(rank, size, distance, low, high, factor):  # type: ignore[no-untyped-def]
    """Bring distance (βH, βW) between low and high (H, W) of its low-resolution pixel, NaN = unknown."""
    rows, columns = low.shape
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        for u in range(i * factor, (i + 1) * factor):
            for j in range(columns):
                least, most = low[i, j], high[i, j]
                for v in range(j * factor, (j + 1) * factor):
                    value = distance[u, v]
                    value = least if value < least else value
                    distance[u, v] = most if value > most else value
