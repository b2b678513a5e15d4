"""From a map of phasors to distance and amplitude."""

import numpy as np
from numba import njit


@njit(fastmath={"contract", "nsz"}, error_model="numpy")
def _angle(y, x):  # type: ignore[no-untyped-def]
    """The angle of (x, y) from 0 up to a turn, to 2e-7; without branches, so that it is computed in vectors.

    The polynomial is that of S. L. Moshier's Cephes library (atanf).
    """
    one, quarter = np.float32(1), np.float32(np.pi / 4)
    a, b = abs(x), abs(y)
    small, large = min(a, b), max(a, b)
    steep = small > np.float32(0.41421356) * large  # tan π/8
    top, bottom = (small - large, small + large) if steep else (small, large)
    t = top / bottom if bottom > 0 else np.float32(0)
    z = t * t
    series = (np.float32(8.05374449538e-2) * z - np.float32(1.38776856032e-1)) * z + np.float32(
        1.99777106478e-1
    )
    angle = ((series * z - np.float32(3.33329491539e-1)) * z + one) * t + (
        quarter if steep else np.float32(0)
    )
    angle = np.float32(np.pi / 2) - angle if b > a else angle
    angle = np.float32(np.pi) - angle if x < 0 else angle
    return np.float32(2 * np.pi) - angle if y < 0 else angle


@njit(nogil=True, cache=True, error_model="numpy")
def resolve(rank, size, real, imaginary, low, high, factor, least, scale, usual):  # type: ignore[no-untyped-def]
    """In place: real part → distance, from 0 up to a turn; imaginary part → amplitude.

    Args:
        real, imaginary: (rows, columns), in median amplitudes.
        low, high: (rows / factor, columns / factor), the distances to believe; others become NaN.
        least: amplitude under which the angle is lost, which makes the distance NaN.
        scale: distance by radian; usual: the median amplitude.
    """
    rows, columns = real.shape
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        first, last = np.repeat(low[i // factor], factor), np.repeat(high[i // factor], factor)
        x, y = real[i], imaginary[i]
        for j in range(columns):
            length, distance = np.sqrt(x[j] * x[j] + y[j] * y[j]), _angle(y[j], x[j]) * scale
            y[j] = length * usual
            x[j] = distance if length >= least else np.float32(np.nan)
        for j in range(columns):
            x[j] = x[j] if first[j] <= x[j] <= last[j] else np.float32(np.nan)
