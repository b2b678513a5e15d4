"""How far the samples lie off a mosaic, by place."""

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.grid import PLACES, Borders, Place
from solver.registration.mosaic import Mosaic
from solver.registration.points import Points
from solver.registration.sums import WITHIN

Image = NDArray[np.float32]

AROUND = 3  # cells to a side whose samples count: about forty of a burst of 15 frames
FEWEST = 0.01  # samples a cell; where there are none, the variance is taken for what it should be
MOST = 1e4  # times the expected variance: beyond, nothing is left of a weight anyhow


class Misfit:
    """Squared residuals by the cell of a grid that they lie in, which frames may be added to.

    It says what no noise law does: how noisy dark pixels are where no amplitude tells it, and where pixels
    mix so that a mosaic cannot follow.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._sums = np.zeros((2, *size), np.float32)

    def add(self, points: Points, place: Place, mosaic: Mosaic) -> None:
        """Add what points at places (rows, columns) lie off a mosaic."""
        grid = mosaic.grid
        _gather(points.values, points.weights, *place, *grid.origin, grid.density, mosaic.values, *self._sums)

    def fade(self, keep: float) -> None:
        """Let what was added count less."""
        self._sums *= np.float32(keep)

    def extend(self, borders: Borders) -> None:
        """Go on with a larger grid."""
        self._sums = np.pad(self._sums, ((0, 0), *borders))

    def image(self) -> Image:
        """Mean squared residual (rows, columns) around each cell, in σ², at least 1."""
        squares, counts = (cv2.blur(image, (AROUND, AROUND)) for image in self._sums)
        return np.clip(squares / np.maximum(counts, np.float32(FEWEST)), 1, np.float32(MOST))


@numba.njit(cache=True, fastmath=PLACES)
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
