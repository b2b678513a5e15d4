"""The deviation map: how steep the fused map is, and one deviation per pixel from that and the samples."""

import numpy as np
from numba import njit

from solver.kernels.prior import COLUMNS, ROWS


@njit(nogil=True, fastmath=True, cache=True)
def steepness(rank, size, x, out):  # type: ignore[no-untyped-def]
    """out ← ‖∇x‖₂ by pixel of (rows, columns), the differences of `solver.prior`."""
    rows, columns = x.shape
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        target = out[i]
        target[:] = 0
        for k in range(6):
            down, right = ROWS[k], COLUMNS[k]
            if i + down >= rows or abs(right) >= columns:
                continue
            first, last = max(0, -right), columns - max(0, right)
            here, there = x[i, first:last], x[i + down, first + right : last + right]
            square, share = target[first:last], x.dtype.type(1 / (down * down + right * right))
            for j in range(last - first):
                square[j] += share * (here[j] - there[j]) * (here[j] - there[j])
        for j in range(columns):
            target[j] = np.sqrt(target[j])


@njit(nogil=True, fastmath={"contract", "arcp", "reassoc", "nsz"}, cache=True, error_model="numpy")
def combine(rank, size, samples, noise, least, steep, shift, away, scale, most, distance):  # type: ignore[no-untyped-def]
    """steep ← √(noise² / samples + (shift · steep)²), doubled with each unit that the nearest sample is away.

    Both it and distance become NaN further away than `most` units; images (rows, columns).

    Args:
        samples: counted as `least` where there are fewer.
        away: in pixels, `scale` times as many units.
    """
    rows, columns = steep.shape
    double = np.float32(np.log(2.0))
    for i in range(rank * rows // size, (rank + 1) * rows // size):
        n, s, a, d = samples[i], steep[i], away[i], distance[i]
        for j in range(columns):
            s[j] = np.sqrt(noise * noise / max(n[j], least) + shift * shift * s[j] * s[j])
        for j in range(columns):
            if a[j] > 0:
                units = a[j] * scale
                s[j] *= np.exp(double * min(units, np.float32(20)))
                if units > most:
                    s[j] = np.float32(np.nan)
                    d[j] = np.float32(np.nan)
