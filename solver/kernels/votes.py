"""What samples lack; see `solver.completion.reason`."""

import numpy as np
from numba import njit

from solver.kernels.medians import find


@njit
def _brightest(measured, light):  # type: ignore[no-untyped-def]
    """The largest amplitude of a valid sample."""
    most = -np.inf
    for k in range(measured.shape[0]):
        for i in range(measured.shape[1]):
            for j in range(measured.shape[2]):
                if light[k, i, j] > most and not np.isnan(measured[k, i, j]):
                    most = light[k, i, j]
    return most if most > -np.inf else np.inf


@njit(nogil=True, cache=True)
def vote(used, measured, light, positions, asked, votes):  # type: ignore[no-untyped-def]
    """votes (3, H, W) += the samples that are too dark, saturated, contradicted, by the pixel they look at.

    Invalid ones that are brighter than any valid one are saturated.

    Args:
        used: (N, H, W), distances used, any unit, NaN = not.
        measured: (N, H, W), distances measured, NaN = invalid.
        light: (N, H, W), amplitudes, any unit.
        positions: (N, H, W, 2), pixels of frame 0.
        asked: (H, W), the pixels that are voted on.
        votes: (3, H, W), in place.
    """
    frames, rows, columns = used.shape
    wanted, cast = asked.reshape(-1), votes.reshape(3, -1)
    places = np.empty(columns, np.int32)
    most, searched = np.inf, False
    for k in range(frames):
        for i in range(rows):
            find(positions[k, i], rows, columns, places)
            for j in range(columns):
                if places[j] < 0 or not wanted[np.uintp(places[j])]:
                    continue
                cause = 0
                if np.isnan(measured[k, i, j]):
                    if not searched:
                        most, searched = _brightest(measured, light), True
                    cause = 1 if light[k, i, j] > most else 0
                elif np.isnan(used[k, i, j]):
                    cause = 2
                cast[cause, np.uintp(places[j])] += 1
