"""A chessboard before a wall, for calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.simulation.scene import Surface, plate

WHITE, PRINT, WALL = 0.8, 0.08, 0.5
"""Reflectivities: paper, toner (which near infrared sees paler than carbon ink), a wall."""

IN_FRONT = 5e-5
"""Metres by which the print stands out of the paper, so that it is hit first."""


@dataclass(frozen=True)
class Chessboard:
    """A printed board.

    Attributes:
        columns, rows: inner corners.
        square: side of a field, metres.
    """

    columns: int = 9
    rows: int = 6
    square: float = 0.05

    def surfaces(self, rotation: ArrayLike, centre: ArrayLike) -> list[Surface]:
        """The board turned by a (3, 3) rotation (board axes: x right, y down, z away) about its centre."""
        R, at = np.asarray(rotation, dtype=np.float64), np.asarray(centre, dtype=np.float64)
        width, height = (self.columns + 3) * self.square, (self.rows + 3) * self.square
        paper = plate(at, width, height, WHITE, normal=-R[:, 2], up=-R[:, 1])
        fields = [
            plate(at + R @ place, self.square, self.square, PRINT, normal=-R[:, 2], up=-R[:, 1])
            for place in self._dark_fields()
        ]
        return [paper, *fields]

    def _dark_fields(self) -> list[NDArray[np.float64]]:
        return [
            np.array([(i - self.columns / 2) * self.square, (j - self.rows / 2) * self.square, -IN_FRONT])
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
            if (i + j) % 2 == 0
        ]


def board_scene() -> list[Surface]:
    """A board of 9 × 6 inner corners, fields of 50 mm, at 1.15 m, turned away by 25°; a wall at 2.5 m."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("yx", [25.0, 15.0], degrees=True).as_matrix()
    return [*Chessboard().surfaces(turned, (0.0, 0.0, 1.15)), plate((0, 0, 2.5), 20, 20, WALL)]
