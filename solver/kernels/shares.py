"""Samples in the place of mixed ones; see `solver.preparation.unmixing`."""

import numpy as np
from numba import njit

from solver.kernels.medians import find


@njit(nogil=True, cache=True, error_model="numpy")
def classify(rank, size, distance, sigma, most, positions, bounds, pure, halves):  # type: ignore[no-untyped-def]
    """halves (N, H, W) ← in which half of the way samples lie, by the pixel of the grid that they fall on.

    ε in the near half, −ε in the far one, 0 outside of what is counted, NaN where the sample is lost, and ∞
    where none looks. Of two of a frame on one pixel the later counts. By a team.

    Args:
        distance: (N, H, W), any unit, NaN = lost.
        sigma: (N, H, W), deviations in distance's unit.
        most: deviation from which a sample is lost.
        positions: (N, H, W, 2), pixels of frame 0.
        bounds: two of (H, W), the nearest and the farthest distance around; infinite where it is not known.
        pure: (least ε, ε in deviations), the part of the way from either end in which samples do not count.
        halves: (N, H, W) ←.
    """
    frames, rows, columns = distance.shape
    near, far = bounds[0].reshape(-1), bounds[1].reshape(-1)
    places = np.empty(columns, np.int32)
    for k in range(rank * frames // size, (rank + 1) * frames // size):
        halves[k] = np.float32(np.inf)
        out = halves[k].reshape(-1)
        for i in range(rows):
            find(positions[k, i], rows, columns, places)
            for j in range(columns):
                if places[j] < 0:
                    continue
                place = np.uintp(places[j])
                y, s, span = distance[k, i, j], sigma[k, i, j], far[place] - near[place]
                part = (far[place] - y) / span
                least = max(pure[0], pure[1] * s / span)
                counts = least < part < 1 - least  # refuses NaN
                half = (least if part > np.float32(0.5) else -least) if counts else np.float32(0)
                out[place] = half if s <= most and y == y else np.float32(np.nan)


@njit(nogil=True, cache=True)
def tally(rank, size, halves, counts):  # type: ignore[no-untyped-def]
    """counts (4, H, W) ← how many samples look at a pixel and are lost, and n₁ − ε n and n₂ − ε n; by a team.

    Args:
        halves: (N, H, W), of `classify`.
        counts: (4, H, W) ←.
    """
    frames, rows, columns = halves.shape
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        counts[:, i] = 0
        for k in range(frames):
            for j in range(columns):
                half = halves[k, i, j]
                known = np.isfinite(half)
                least = abs(half) if known else np.float32(0)
                counts[0, i, j] += half < np.inf or half != half
                counts[1, i, j] += half != half
                counts[2, i, j] += (known and half > 0) - least
                counts[3, i, j] += (known and half < 0) - least


@njit(nogil=True, cache=True)
def outermost(rank, size, distance, sigma, most, away, positions, outer):  # type: ignore[no-untyped-def]
    """outer (2, R, H, W) ← the R nearest of y + away · σ and of −y + away · σ by pixel of the grid, sorted.

    Infinite where fewer are sure. By a team, of which each looks through all samples for those on its rows.

    Args:
        distance: (N, H, W), any unit, NaN = not used.
        sigma: (N, H, W), deviations in distance's unit.
        most: deviation from which a sample is not sure.
        away: deviations.
        positions: (N, H, W, 2), pixels of frame 0.
        outer: (2, R, H, W) ←.
    """
    frames, rows, columns = distance.shape
    first, last = rank * rows // size, (rank + 1) * rows // size
    outer[:, :, first:last] = np.float32(np.inf)
    nearest, farthest = outer[0].reshape(outer.shape[1], -1), outer[1].reshape(outer.shape[1], -1)
    places = np.empty(columns, np.int32)
    for k in range(frames):
        for i in range(rows):
            find(positions[k, i], rows, columns, places)
            for j in range(columns):
                y, s, place = distance[k, i, j], sigma[k, i, j], places[j]
                if s <= most and first * columns <= place < last * columns and y == y:
                    _insert(y + away * s, nearest, np.uintp(place))
                    _insert(away * s - y, farthest, np.uintp(place))


@njit
def _insert(value, ranked, place):  # type: ignore[no-untyped-def]
    """Put a value in its order among the least at a place, of which the greatest is given up."""
    if value < ranked[-1, place]:
        for at in range(ranked.shape[0]):
            if value < ranked[at, place]:
                value, ranked[at, place] = ranked[at, place], value


@njit(nogil=True, cache=True, error_model="numpy")
def light_up(rank, size, distance, sigma, most, positions, amplitude, bounds, doubt, sums):  # type: ignore[no-untyped-def]
    """sums (7, H, W) ← by pixel of the grid: samples that look there, lost ones, and the sums of (1) in
    `solver.preparation.lights`, A S², A S (1 − S), A (1 − S)², S and 1 − S.

    By a team, of which each looks through all samples for those on its rows.

    Args:
        distance: (N, H, W), any unit, NaN = lost.
        sigma: (N, H, W), deviations in distance's unit.
        most: deviation from which a sample is lost.
        positions: (N, H, W, 2), pixels of frame 0.
        amplitude: (N, H, W), any unit.
        bounds: two of (H, W), the nearest and the farthest distance around; infinite where it is not known.
        doubt: a sample of which half as many deviations span the way between the bounds does not count, and
            counts in full where all of them do.
        sums: (7, H, W) ←.
    """
    frames, rows, columns = distance.shape
    first, last = rank * rows // size, (rank + 1) * rows // size
    sums[:, first:last] = 0
    near, far = bounds[0].reshape(-1), bounds[1].reshape(-1)
    into, places, one = sums.reshape(7, -1), np.empty(columns, np.int32), np.float32(1)
    for k in range(frames):
        for i in range(rows):
            find(positions[k, i], rows, columns, places)
            for j in range(columns):
                if not first * columns <= places[j] < last * columns:
                    continue
                place = np.uintp(places[j])
                y, s, light = distance[k, i, j], sigma[k, i, j], amplitude[k, i, j]
                into[0, place] += one
                if not (s <= most and y == y):
                    into[1, place] += one
                    continue
                span = far[place] - near[place]
                if not (0 < span < np.inf and light > 0):
                    continue
                part = min(max((far[place] - y) / span, np.float32(0)), one)
                sure = min(max(2 - doubt * s / span, np.float32(0)), one)
                into[2, place] += sure * light * part * part
                into[3, place] += sure * light * part * (one - part)
                into[4, place] += sure * light * (one - part) * (one - part)
                into[5, place] += sure * part
                into[6, place] += sure * (one - part)


@njit(nogil=True, cache=True, error_model="numpy")
def unmix(rank, size, measured, sigma, positions, bounds, ratio, least, doubt, error, distance, deviation):  # type: ignore[no-untyped-def]
    """distance and deviation (N, H, W) ← what samples would be if they were means of distances; by a team.

    Args:
        measured: (N, H, W), any unit, NaN stays.
        sigma: (N, H, W), deviations in distance's unit.
        positions: (N, H, W, 2), pixels of frame 0.
        bounds: two of (H, W), the nearest and the farthest distance around.
        ratio: (H, W), the logarithm of how many times as bright the near one is as the far one.
        least: the least deviation.
        doubt: a sample of which half as many deviations span the way between the bounds stays as it is, and
            counts in full where all of them do.
        error: times p (1 − p), of the way between the bounds: what a mean errs by.
        distance: (N, H, W) ←.
        deviation: (N, H, W) ←.
    """
    frames, rows, columns = measured.shape
    near, far, lights = bounds[0].reshape(-1), bounds[1].reshape(-1), ratio.reshape(-1)
    places, one = np.empty(columns, np.int32), np.float32(1)
    for line in range(rank * frames * rows // size, (rank + 1) * frames * rows // size):
        k, i = line // rows, line % rows
        find(positions[k, i], rows, columns, places)
        for j in range(columns):
            y, s = measured[k, i, j], sigma[k, i, j]
            distance[k, i, j], deviation[k, i, j] = y, max(s, least)
            if places[j] < 0:
                continue
            place = np.uintp(places[j])
            span, part = far[place] - near[place], far[place] - y
            if not (0 < part < span < np.inf) or lights[place] == 0:
                continue
            sure = min(max(2 - doubt * s / span, 0), 1)
            part, light = part / span, np.exp(sure * lights[place])
            share = part / (part + light * (one - part))
            whole = share * light + one - share
            slope = min(light / (whole * whole), one)
            wrong = error * span * share * (one - share)
            distance[k, i, j] = far[place] - share * span
            own = max(s, least) / slope
            deviation[k, i, j] = np.sqrt(own * own + wrong * wrong)
