"""A chessboard or ChArUco board, and where an amplitude image shows its corners."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from service.errors import CalibrationError

UPSAMPLINGS = (4, 3, 6)
"""The detectors want fields of tens of pixels; a field of such a small camera has about ten."""

CORNER_WINDOW = 0.33
"""Half the side of the window in which a corner is refined, in fields: neither neighbour reaches in."""


@dataclass(frozen=True)
class Board:
    """A printed board.

    Attributes:
        columns, rows: inner corners.
        square: side of a field, metres.
        dictionary: of a ChArUco board, as OpenCV names it (`DICT_4X4_50`); None = a chessboard.
        marker: side of a marker, metres (ChArUco only).
    """

    columns: int
    rows: int
    square: float
    dictionary: str | None = None
    marker: float = 0.0

    @property
    def points(self) -> NDArray[np.float64]:
        """(rows · columns, 3) corners, metres; the origin is the first one, x along a row."""
        j, i = np.mgrid[: self.rows, : self.columns]
        places = np.stack([i.ravel(), j.ravel(), np.zeros(i.size)], axis=1) * self.square
        return np.asarray(places, dtype=np.float64)

    @property
    def outline(self) -> NDArray[np.float64]:
        """(4, 2) its outermost corners, metres."""
        width, height = (self.columns - 1) * self.square, (self.rows - 1) * self.square
        return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])


@dataclass(frozen=True)
class Sighting:
    """The board in one image.

    Attributes:
        points: (M, 3) corners seen, in board coordinates, metres.
        pixels: (M, 2) where they are seen: column, row.
        outline: (4, 2) where the board's outermost corners lie, or would lie, column, row.
    """

    points: NDArray[np.float64]
    pixels: NDArray[np.float64]
    outline: NDArray[np.float64]


def find_board(amplitude: NDArray[np.generic], board: Board) -> Sighting | None:
    """The board in an amplitude image, or None where it is not (wholly, for a chessboard) in view.

    Args:
        amplitude: (H, W), any linear unit; NaN counts as dark.
    """
    for upsampling in UPSAMPLINGS:
        picture = _picture(amplitude, upsampling)
        found = _chessboard(picture, board) if board.dictionary is None else _charuco(picture, board)
        if found is not None:
            points, places = found
            refined = _refined(picture, places, points, board)
            # Pixel centres are at integers in both images.
            pixels = (refined + 0.5) / upsampling - 0.5
            return Sighting(points, pixels, _outline(points, pixels, board))
    return None


def _picture(amplitude: NDArray[np.generic], upsampling: int) -> NDArray[np.uint8]:
    """8 bits, square root of the amplitude: the lamp beside the lens lights the near side far more."""
    light = np.sqrt(np.nan_to_num(amplitude.astype(np.float64), nan=0.0))
    dark, bright = np.percentile(light, (2, 99.5))
    scaled = np.clip(255 * (light - dark) / max(bright - dark, 1e-9), 0, 255).astype(np.uint8)
    large = cv2.resize(scaled, None, fx=upsampling, fy=upsampling, interpolation=cv2.INTER_CUBIC)
    return np.asarray(large, dtype=np.uint8)


Corners = tuple[NDArray[np.float64], NDArray[np.float64]]


def _chessboard(picture: NDArray[np.uint8], board: Board) -> Corners | None:
    found, corners = cv2.findChessboardCornersSB(picture, (board.columns, board.rows), flags=0)
    if not found:
        return None
    return board.points, np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def _charuco(picture: NDArray[np.uint8], board: Board) -> Corners | None:
    number = getattr(cv2.aruco, str(board.dictionary), None)
    if not str(board.dictionary).startswith("DICT_") or number is None:
        raise CalibrationError(
            f"OpenCV knows no marker dictionary {board.dictionary!r}; expected one such as DICT_4X4_50"
        )
    printed = cv2.aruco.CharucoBoard(
        (board.columns + 1, board.rows + 1),
        board.square,
        board.marker,
        cv2.aruco.getPredefinedDictionary(number),
    )
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(printed).detectBoard(picture)
    if numbers is None or len(numbers) < 6:  # four determine a pose, two more check it
        return None
    chosen = board.points[np.asarray(numbers).ravel()]
    return chosen, np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def _refined(
    picture: NDArray[np.uint8], places: NDArray[np.float64], points: NDArray[np.float64], board: Board
) -> NDArray[np.float64]:
    """Corners where the grey values' saddle is."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    neighbours = np.isclose(np.linalg.norm(points[:, None] - points[None], axis=2), board.square)
    field = float(apart[neighbours].min()) if neighbours.any() else float(apart[apart > 0].min())
    # Half of the white rim around a marker, which must not come into the window.
    share = CORNER_WINDOW if board.dictionary is None else (1 - board.marker / board.square) / 2
    half = max(3, round(share * field))
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 80, 1e-4)
    start = places.astype(np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(picture, start, (half, half), (-1, -1), end)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _outline(points: NDArray[np.float64], pixels: NDArray[np.float64], board: Board) -> NDArray[np.float64]:
    plane, _ = cv2.findHomography(points[:, :2], pixels)
    corners = cv2.perspectiveTransform(board.outline.reshape(-1, 1, 2), plane)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2)
