"""From log-amplitude and phase to distance and amplitude."""

import numpy as np
from numba import njit

from solver.kernels.elementary import exponential, sine_cosine


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
    circle, half, nothing = np.float32(2 * np.pi), np.float32(0.5), np.float32(np.nan)
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        x, y, n, a, b = logs[i], phases[i], seen[i], mean[0, i], mean[1, i]
        for j in range(columns):
            length, phase = exponential(x[j]), y[j]
            sine, cosine = sine_cosine(phase)
            angle = phase - circle * np.floor((phase - cut) / circle)
            own, around = length * length, a[j] * a[j] + b[j] * b[j]
            astray = (own < faint * around) & (a[j] * cosine + b[j] * sine < half * np.sqrt(around))
            told = (n[j] * min(own, around) >= least) & ~astray
            x[j] = angle * scale if told else nothing
            y[j] = length * unit
