"""A chessboard before a wall, for calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.calibration import Calibration
from drivers.simulation.scene import Surface, plate

WHITE, PRINT, WALL = 0.8, 0.08, 0.5
"""Reflectivities: paper, toner (which near infrared sees paler than carbon ink), a wall."""

TILTS = (
    (0.0, 0.0, 0.0), (30.0, 0.0, 5.0), (-30.0, 0.0, -5.0), (0.0, 30.0, 8.0), (0.0, -30.0, -8.0),
    (22.0, 22.0, 0.0), (-22.0, 22.0, 10.0), (22.0, -22.0, -10.0), (-22.0, -22.0, 0.0),
)  # fmt: skip
"""Yaw, pitch and roll of one view after the other, degrees."""

PLACES = (
    (0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (0, -1), (0, 1), (-1, 0), (1, 0)
)  # fmt: skip
"""Middle, corners and sides of the image, right and down."""

FILLS = (0.62, 0.72, 0.55, 0.66)
"""Of the image, by the board's fields and half a field around them."""

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


@dataclass(frozen=True)
class BoardPose:
    """How a board is held: (3, 3) board axes to those that its centre, metres, is given in."""

    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]

    def seen_from(self, looking: NDArray[np.float64], centre: NDArray[np.float64]) -> BoardPose:
        """A pose in camera axes as one in stage axes, the camera being at `centre` with axes `looking`."""
        return BoardPose(looking @ self.rotation, looking @ self.centre + centre)


def board_scene(board: Chessboard | None = None, away: float = 1.15) -> list[Surface]:
    """A board (9 × 6 inner corners, fields of 50 mm), turned away by 25°, and a wall."""
    return shown(board or Chessboard(), BoardPose(_turned(25.0, 15.0), np.array([0.0, 0.0, away])))


def shown(board: Chessboard, pose: BoardPose) -> list[Surface]:
    """The board held like that; a wall at 2.5 m, or behind it."""
    wall = plate((0, 0, max(2.5, pose.centre[2] + 1.0)), 20, 20, WALL)
    return [*board.surfaces(pose.rotation, pose.centre), wall]


def board_views(board: Chessboard, count: int, calibration: Calibration) -> list[BoardPose]:
    """Poses that calibrate optics: all over the image, near, tilted every way, and whole in view.

    Each of `PLACES` comes with another tilt every time; the board fills `FILLS` of the image's width, and is
    moved from the middle towards its place as far as it stays in the image.
    """
    rounds = [(k, k // len(PLACES)) for k in range(count)]
    return [
        _placed(
            board,
            TILTS[(k + lap) % len(TILTS)],
            FILLS[k % len(FILLS)],
            np.array(PLACES[k % len(PLACES)]),
            calibration,
        )
        for k, lap in rounds
    ]


def _placed(
    board: Chessboard,
    tilt: tuple[float, float, float],
    fill: float,
    place: NDArray[np.int_],
    calibration: Calibration,
) -> BoardPose:
    k, (height, width) = calibration.intrinsics, calibration.shape
    paper = ((board.columns + 2) * board.square, (board.rows + 2) * board.square)
    away = max(paper[0] * k.fx / (fill * width), paper[1] * k.fy / (fill * height))
    reach = np.array([(width / 2) * away / k.fx, (height / 2) * away / k.fy])
    middle = np.array([(width - 1) / 2 - k.cx, (height - 1) / 2 - k.cy]) * away / [k.fx, k.fy]

    def pose(across: float, down: float) -> BoardPose:
        offset = np.array([across, down]) * place * reach
        return BoardPose(_turned(*tilt), np.array([*(middle + offset), away]))

    def farthest(held: Callable[[float], BoardPose]) -> float:
        shares = (float(share) for share in np.linspace(1, 0, 41))
        return next((share for share in shares if _is_whole(board, held(share), calibration)), 0.0)

    across = farthest(lambda share: pose(share, 0.0))
    down = farthest(lambda share: pose(across, share))
    return pose(across, down)


def _is_whole(board: Chessboard, pose: BoardPose, calibration: Calibration) -> bool:
    """Whether the fields and half a field around them lie in the image."""
    import cv2

    x, y = (board.columns + 2) * board.square / 2, (board.rows + 2) * board.square / 2
    outline = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0], [0, -y, 0], [0, y, 0]])
    seen, _ = cv2.projectPoints(
        outline @ pose.rotation.T + pose.centre,
        np.zeros(3),
        np.zeros(3),
        calibration.intrinsics.matrix,
        np.array(calibration.distortion or (0.0,) * 5),
    )
    column, row = seen.reshape(-1, 2).T
    height, width = calibration.shape
    return bool(min(column.min(), row.min()) > 0 and column.max() < width - 1 and row.max() < height - 1)


def _turned(yaw: float, pitch: float, roll: float = 0.0) -> NDArray[np.float64]:
    """(3, 3), about the axes y, x and z, degrees."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("yxz", [yaw, pitch, roll], degrees=True).as_matrix())
