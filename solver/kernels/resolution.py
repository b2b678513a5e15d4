"""From log-amplitude and phase to distance and amplitude."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def resolve(rank, size, logs, phases, seen, mean, scale, unit, cut, least, faint):  # type: ignore[no-untyped-def]
    """In place: log-amplitude → distance, from `cut` up to a circle more; phase → amplitude; by a team.

    Args:
        logs, phases, seen: (rows, columns); seen: how many samples see each pixel.
        mean: (2, rows, columns), the mean of the phasors around each.
        scale: distance by radian; unit: of the amplitude; cut: in radians.
        least: seen · |Z|² below which the distance is lost, which makes it NaN; for the mean's |Z| too.
        faint: part of the mean's |Z|² below which it is lost where it lies over 60° from the mean's.
    """
    rows, columns = logs.shape
    circle = np.float32(2 * np.pi)
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        x, y, n, a, b = logs[i], phases[i], seen[i], mean[0, i], mean[1, i]
        for j in range(columns):
            length, phase = np.exp(x[j]), y[j]
            angle = phase - circle * np.floor((phase - cut) / circle)
            own, around = length * length, a[j] * a[j] + b[j] * b[j]
            told = n[j] * min(own, around) >= least
            if own < faint * around:
                told &= a[j] * np.cos(phase) + b[j] * np.sin(phase) >= np.float32(0.5) * np.sqrt(around)
            x[j] = angle * scale if told else np.float32(np.nan)
            y[j] = length * unit
