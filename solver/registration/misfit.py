"""How far the samples lie off a mosaic, by place."""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels.nodes import add_misfit
from solver.registration.grid import Borders, Place
from solver.registration.mosaic import Mosaic
from solver.registration.point_samples import Points
from solver.runtime import team

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
        grid, others = mosaic.grid, np.zeros_like(self._sums)
        samples = points.values, points.weights, *place, points.first
        team.hand_out(
            len(points.weights),
            add_misfit,
            *samples,
            grid.origin,
            grid.density,
            mosaic.values,
            self._sums,
            others,
        )
        self._sums += others

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
