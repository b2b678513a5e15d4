"""What samples lack; see `solver.completion.reason`."""

import numpy as np
from numba import njit


@njit
def _brightest(measured, light):  # type: ignore[no-untyped-def]
    """The largest amplitude of a valid sample."""
    most = -np.inf
    for k in range(measured.size):
        if light.flat[k] > most and not np.isnan(measured.flat[k]):
            most = light.flat[k]
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
    most = _brightest(measured, light)
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                row, column = positions[k, i, j, 0] + 0.5, positions[k, i, j, 1] + 0.5
                if not (0 <= row < rows and 0 <= column < columns and asked[int(row), int(column)]):
                    continue
                cause = 0
                if np.isnan(measured[k, i, j]):
                    cause = 1 if light[k, i, j] > most else 0
                elif np.isnan(used[k, i, j]):
                    cause = 2
                votes[cause, int(row), int(column)] += 1
