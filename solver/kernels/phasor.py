"""From a map of phasors to distance and amplitude."""

import numpy as np
from numba import njit, prange


@njit(parallel=True, cache=True)
def resolve(real, imaginary, low, high, factor, least, scale, usual):  # type: ignore[no-untyped-def]
    """In place: real part → distance, from 0 up to a turn; imaginary part → amplitude.

    Args:
        real, imaginary: (rows, columns), in median amplitudes.
        low, high: (rows / factor, columns / factor), the distances to believe; others become NaN.
        least: amplitude under which the angle is lost, which makes the distance NaN.
        scale: distance by radian; usual: the median amplitude.
    """
    rows, columns = real.shape
    turn = np.float32(2 * np.pi)
    for i in prange(rows):
        first, last, x, y = low[i // factor], high[i // factor], real[i], imaginary[i]
        for j in range(columns):
            size, angle = np.sqrt(x[j] * x[j] + y[j] * y[j]), np.arctan2(y[j], x[j])
            if angle < 0:
                angle += turn
            distance, at = angle * scale, j // factor
            believed = size >= least and first[at] <= distance <= last[at]
            x[j] = distance if believed else np.float32(np.nan)
            y[j] = size * usual
