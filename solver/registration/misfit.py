"""How far the samples lie off a mosaic, by place."""

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.grid import Place
from solver.registration.mosaic import Mosaic
from solver.registration.points import Points
from solver.registration.sums import WITHIN

Image = NDArray[np.float32]

AROUND = 3  # cells to a side whose samples count: about forty of a burst of 15 frames
MOST = 1e4  # times the expected variance: beyond, nothing is left of a weight anyhow


def local_misfit(points: Points, place: Place, mosaic: Mosaic) -> Image:
    """Mean squared residual (rows, columns) around each of the mosaic's cells, in σ², at least 1.

    It says what no noise law does: how noisy dark pixels are where no amplitude tells it, and where pixels
    mix so that the grid cannot follow.
    """
    grid = mosaic.grid
    squares, counts = np.zeros((2, *grid.size), np.float32)
    _gather(points.values, points.weights, *place, *grid.origin, grid.density, mosaic.values, squares, counts)
    size = (AROUND, AROUND)
    mean = cv2.blur(squares, size) / np.maximum(cv2.blur(counts, size), np.float32(1e-3))
    return np.clip(mean, 1, np.float32(MOST))


@numba.njit(cache=True, fastmath=True)
def _gather(values, weights, row, column, row0, column0, density, U, squares, counts):  # type: ignore[no-untyped-def]
    channels, rows, columns = U.shape
    top, left, scale, one = np.float32(row0), np.float32(column0), np.float32(density), np.float32(1.0)
    share = one / np.float32(channels)
    for s in range(len(weights)):
        r, c = (row[s] - top) * scale, (column[s] - left) * scale
        if not (r >= 0.0 and c >= 0.0 and r < rows - 1 and c < columns - 1):
            continue
        m, n = int(r) & WITHIN, int(c) & WITHIN
        a, d = r - np.float32(m), c - np.float32(n)
        square = np.float32(0.0)
        for h in range(channels):
            up = (one - d) * U[h, m, n] + d * U[h, m, n + 1]
            low = (one - d) * U[h, m + 1, n] + d * U[h, m + 1, n + 1]
            residual = values[s, h] - (one - a) * up - a * low
            square += residual * residual
        squares[m, n] += share * weights[s] * square
        counts[m, n] += one
