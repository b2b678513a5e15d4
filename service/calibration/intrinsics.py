"""Focal length, principal point and distortion from views of a board (Zhang 2000, by OpenCV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Intrinsics
from service.calibration.board import Sighting
from service.errors import CalibrationError

LEAST_VIEWS = 8
"""Each view gives two equations for five unknowns; the rest averages out what corners are off."""

APART = 0.03
"""Two views are different where some corner of the board has moved by this share of the image's width."""

LEAST_TILT = np.radians(20.0)
"""Views of a board that always faces the same way do not tell focal length from distance."""

LEAST_COVERAGE = 0.5
"""Share of the image's cells in which corners must lie, or distortion there is a guess."""

CELLS = (4, 5)
"""Rows and columns of cells by which coverage is counted."""

LARGEST_ERROR = 0.5
"""Pixels RMS; corners are found to about 0.1."""

OUTLIER = 3.0
"""A view whose error is this many times the median is left out."""


@dataclass(frozen=True)
class IntrinsicsFit:
    """What was found.

    Attributes:
        intrinsics, distortion: OpenCV's model with k1, k2, p1, p2.
        deviations: one standard deviation of fx, fy, cx, cy, pixels.
        error: RMS reprojection error, pixels.
        view_errors: the same of each view.
        sightings: the views used.
        left_out: views that did not fit the others.
        coverage: share of the image's cells that hold a corner.
        tilt: largest angle between two views' boards, radians.
        residuals: (M, 2) of every corner, pixels.
    """

    intrinsics: Intrinsics
    distortion: tuple[float, float, float, float]
    deviations: tuple[float, float, float, float]
    error: float
    view_errors: tuple[float, ...]
    sightings: tuple[Sighting, ...]
    left_out: int
    coverage: float
    tilt: float
    residuals: NDArray[np.float64]

    def apply(self, calibration: Calibration) -> Calibration:
        """`calibration` with these optics."""
        return calibration.model_copy(update={"intrinsics": self.intrinsics, "distortion": self.distortion})

    def __str__(self) -> str:
        k, d = self.intrinsics, self.deviations
        return (
            f"fx {k.fx:.2f} ± {d[0]:.2f}, fy {k.fy:.2f} ± {d[1]:.2f}, cx {k.cx:.2f} ± {d[2]:.2f}, "
            f"cy {k.cy:.2f} ± {d[3]:.2f} pixels; distortion "
            f"{', '.join(f'{value:.4f}' for value in self.distortion)}; reprojection error "
            f"{self.error:.3f} pixels over {len(self.sightings)} views ({self.left_out} left out), "
            f"{100 * self.coverage:.0f} % of the image covered"
        )


def distinct_views(sightings: Sequence[Sighting], width: int) -> list[Sighting]:
    """Views of different poses: of those alike, the first."""
    kept: list[Sighting] = []
    for sighting in sightings:
        if is_new(sighting, kept, width):
            kept.append(sighting)
    return kept


def is_new(sighting: Sighting, kept: Sequence[Sighting], width: int) -> bool:
    """Whether the board stands elsewhere than in all of `kept`."""
    moved = [float(np.linalg.norm(sighting.outline - other.outline, axis=1).max()) for other in kept]
    return not moved or min(moved) > APART * width


def calibrate_intrinsics(sightings: Sequence[Sighting], shape: tuple[int, int]) -> IntrinsicsFit:
    """Fit the camera to views of a board.

    Args:
        sightings: the board in each image; those alike are used once.
        shape: (rows, columns) of the images.

    Raises:
        CalibrationError: too few views, too alike, too little of the image covered, or a poor fit.
    """
    views = distinct_views(sightings, shape[1])
    _require_enough(views, len(sightings))
    covered = coverage(views, shape)
    if covered < LEAST_COVERAGE:
        raise CalibrationError(
            f"the corners cover {100 * covered:.0f} % of the image, at least {100 * LEAST_COVERAGE:.0f} % "
            "are needed: show the board in the corners and along the edges, and nearer"
        )
    first = _fit(views, shape)
    limit = OUTLIER * float(np.median(first.view_errors))
    good = [view for view, error in zip(views, first.view_errors, strict=True) if error <= limit]
    _require_enough(good, len(sightings))
    fit = first if len(good) == len(views) else _fit(good, shape)
    fit = replace(fit, left_out=len(views) - len(good))
    if fit.tilt < LEAST_TILT:
        raise CalibrationError(
            f"the board's directions differ by {np.degrees(fit.tilt):.0f}° at most, at least "
            f"{np.degrees(LEAST_TILT):.0f}° are needed: tilt it left, right, up and down by 30°"
        )
    if fit.error > LARGEST_ERROR:
        raise CalibrationError(
            f"the reprojection error is {fit.error:.2f} pixels, at most {LARGEST_ERROR:g} are expected: "
            "check that the board is flat, its size and numbers of corners as given, and nothing moved"
        )
    return fit


def coverage(views: Sequence[Sighting], shape: tuple[int, int]) -> float:
    """Share of the image's cells that hold a corner."""
    pixels = np.concatenate([view.pixels for view in views])
    cells = np.floor((pixels[:, ::-1] + 0.5) / shape * CELLS).astype(int)
    inside = np.all((cells >= 0) & (cells < CELLS), axis=1)
    return len(np.unique(cells[inside], axis=0)) / (CELLS[0] * CELLS[1])


def _require_enough(views: Sequence[Sighting], seen: int) -> None:
    if len(views) < LEAST_VIEWS:
        raise CalibrationError(
            f"{len(views)} different views of the board, at least {LEAST_VIEWS} are needed ({seen} images "
            "show it whole): move and tilt it more between views, hold it still, keep it whole in view"
        )


def _fit(views: Sequence[Sighting], shape: tuple[int, int]) -> IntrinsicsFit:
    height, width = shape
    start = np.array([[width, 0.0, (width - 1) / 2], [0.0, width, (height - 1) / 2], [0.0, 0.0, 1.0]])
    error, K, distortion, turns, moves, spread, _, view_errors = cv2.calibrateCameraExtended(
        [view.points.astype(np.float32) for view in views],
        [view.pixels.astype(np.float32) for view in views],
        (width, height),
        start,
        np.zeros(5),
        # So few pixels do not determine k3 beside k2.
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3,
    )
    residuals = [
        view.pixels - cv2.projectPoints(view.points, turn, move, K, distortion)[0].reshape(-1, 2)
        for view, turn, move in zip(views, turns, moves, strict=True)
    ]
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    terms = tuple(float(value) for value in np.ravel(distortion)[:4])
    deviations = tuple(float(value) for value in np.ravel(spread)[:4])
    return IntrinsicsFit(
        intrinsics=Intrinsics(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2]),
        distortion=(terms[0], terms[1], terms[2], terms[3]),
        deviations=(deviations[0], deviations[1], deviations[2], deviations[3]),
        error=float(error),
        view_errors=tuple(float(value) for value in np.ravel(view_errors)),
        sightings=tuple(views),
        left_out=0,
        coverage=coverage(views, shape),
        tilt=float(np.arccos(np.clip(normals @ normals.T, -1, 1)).max()),
        residuals=np.concatenate(residuals),
    )
