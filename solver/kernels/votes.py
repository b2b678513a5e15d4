"""What samples lack; see `solver.completion.reason`."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def vote(used, measured, light, most, positions, votes):  # type: ignore[no-untyped-def]
    """votes (3, H, W) += the samples that are too dark, saturated, contradicted, by the pixel they look at.

    Args:
        used: (N, H, W), distances used, any unit, NaN = not.
        measured: (N, H, W), distances measured, NaN = invalid.
        light: (N, H, W), amplitudes, any unit.
        most: the largest amplitude of a valid sample; invalid ones above it are saturated.
        positions: (N, H, W, 2), pixels of frame 0.
        votes: (3, H, W), in place.
    """
    frames, rows, columns = used.shape
    for k in range(frames):
        for i in range(rows):
            for j in range(columns):
                row, column = positions[k, i, j, 0] + 0.5, positions[k, i, j, 1] + 0.5
                if not (0 <= row < rows and 0 <= column < columns):
                    continue
                cause = 0
                if np.isnan(measured[k, i, j]):
                    cause = 1 if light[k, i, j] > most else 0
                elif np.isnan(used[k, i, j]):
                    cause = 2
                votes[cause, int(row), int(column)] += 1
