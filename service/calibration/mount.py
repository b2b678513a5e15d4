"""How the camera sits on the stage, from views of a fixed board at known stage angles.

A corner of the board stands at S(pan, tilt) (M X + l) in stage axes, X being the corner in camera axes, M
the mount's rotation and l its lever arm: one board for all views (the hand–eye problem). Mount and board are
found together by least squares on the corners' pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Mount
from drivers.poses import camera_rotation, stage_rotation
from drivers.position import Position
from service.calibration.board import Sighting
from service.errors import CalibrationError

LEAST_VIEWS = 5
LEAST_TURN = np.radians(8.0)
"""A lever arm of 0.1 m moves the camera by 14 mm over 8°, two pixels at 1.3 m."""

TURNS = np.radians(1.0)
"""An axis that turns by less than this over all views says nothing."""

AS_GOOD = 1.2
"""Two solutions whose errors differ by less than this factor fit equally well."""

LARGEST_ERROR = 0.5
"""Pixels RMS."""


Values = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """The board as seen at one pose of the stage."""

    position: Position
    sighting: Sighting


@dataclass(frozen=True)
class MountFit:
    """What was found.

    Attributes:
        mount: rotation and lever arm.
        deviations: (6,) one standard deviation of the rotation vector (radians) and lever arm (metres); 0
            where the stage's movement says nothing and the value was set to 0.
        error: RMS reprojection error, pixels.
        residuals: (M, 2) of every corner, pixels.
        views: how many.
        turn: how far pan and tilt turned, radians.
    """

    mount: Mount
    deviations: tuple[float, ...]
    error: float
    residuals: NDArray[np.float64]
    views: int
    turn: tuple[float, float]

    def apply(self, calibration: Calibration) -> Calibration:
        """`calibration` with this mount."""
        return calibration.model_copy(update={"mount": self.mount})

    @property
    def looks_back(self) -> bool:
        """Whether the camera's axis points backwards; reversed signs of one stage axis look like that."""
        return bool(self._axes[2, 2] < 0)

    @property
    def is_upright(self) -> bool:
        """Whether the image's upper edge is towards the stage's upper side."""
        return bool(self._axes[1, 1] > 0)

    @property
    def _axes(self) -> NDArray[np.float64]:
        return camera_rotation(0.0, 0.0, self.mount)

    def __str__(self) -> str:
        turn, arm, d = np.degrees(self.mount.rotation), self.mount.lever_arm, self.deviations
        rotation = ", ".join(f"{a:.2f} ± {np.degrees(s):.2f}" for a, s in zip(turn, d[:3], strict=True))
        lever = ", ".join(f"{1e3 * a:.1f} ± {1e3 * s:.1f}" for a, s in zip(arm, d[3:], strict=True))
        still = min(self.turn) < TURNS
        fixed = "; one axis did not turn, what only it could tell is set to 0" if still else ""
        upside = (
            ""
            if self.is_upright
            else ("; the camera hangs upside down, or else the stage turns the wrong way in all its axes")
        )
        return (
            f"rotation ({rotation})°, lever arm ({lever}) mm (right, down, forward); reprojection error "
            f"{self.error:.3f} pixels over {self.views} views{fixed}{upside}"
        )


def calibrate_mount(views: Sequence[View], calibration: Calibration) -> MountFit:
    """Fit the mount to views of one fixed board.

    Args:
        views: the board at each pose of the stage.
        calibration: optics of the camera.

    Raises:
        CalibrationError: too few views, too little turn, a poor fit, or a stage that turns the wrong way.
    """
    if len(views) < LEAST_VIEWS:
        raise CalibrationError(
            f"{len(views)} poses show the board whole, at least {LEAST_VIEWS} are needed: put it nearer to "
            "the middle of the view or farther away, or turn less far"
        )
    angles = np.array([(view.position.pan, view.position.tilt) for view in views])
    turn = np.ptp(angles, axis=0)
    if turn.max() < LEAST_TURN:
        raise CalibrationError(
            f"the stage turned by {np.degrees(turn.max()):.1f}°, at least {np.degrees(LEAST_TURN):.0f}° are "
            "needed: turn farther, with the board still in view"
        )
    fit = _Problem(views, calibration).solve(angles)
    if fit.error > LARGEST_ERROR:
        raise CalibrationError(
            f"the reprojection error is {fit.error:.2f} pixels, at most {LARGEST_ERROR:g} are expected: "
            "check the intrinsics, that the board did not move, and that the stage reports its angles truly"
        )
    if fit.looks_back:
        wrong = "tilt" if fit.is_upright else "pan"
        raise CalibrationError(
            f"the stage turns {wrong} the wrong way (pan > 0 must turn left, tilt > 0 up), unless the camera "
            f"looks backwards: reverse {wrong}_sign in stage.options, and calibrate again"
        )
    return fit


class _Problem:
    """Twelve unknowns: turn of the mount from its start, lever arm, board rotation and place."""

    def __init__(self, views: Sequence[View], calibration: Calibration) -> None:
        self._sightings = [view.sighting for view in views]
        self._K = calibration.intrinsics.matrix
        self._lens = np.array(calibration.distortion or (0.0,) * 5)

    def solve(self, angles: NDArray[np.float64]) -> MountFit:
        """The least squares mount for these stage angles (N, 2)."""
        stage = [stage_rotation(pan, tilt) for pan, tilt in angles]
        fits = [self._solve(angles, stage, start) for start in self._starts(angles)]
        least = min(fit.error for fit in fits)
        good = [fit for fit in fits if fit.error <= AS_GOOD * least + 1e-6]
        return min(good, key=lambda fit: float(np.linalg.norm(fit.mount.rotation)))

    def _solve(
        self,
        angles: NDArray[np.float64],
        stage: Sequence[NDArray[np.float64]],
        rotation: NDArray[np.float64],
    ) -> MountFit:
        from scipy.optimize import least_squares

        free = self._free(angles)
        base = np.asarray(cv2.Rodrigues(rotation)[0], dtype=np.float64)
        x, spread = self._start(stage[0] @ base), np.zeros(12)
        for _ in range(2):  # the second time from the solution, about which the deviations are stated

            def residuals(values: Values, about: Values = base) -> Values:
                return self._residuals(_filled(values, free), stage, about)

            found = least_squares(residuals, x[free], x_scale="jac")
            x = _filled(found.x, free)
            base = np.asarray(cv2.Rodrigues(x[:3])[0] @ base, dtype=np.float64)
            x[:3] = 0.0
        jacobian = np.asarray(found.jac)
        spread[free] = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * found.fun.var())
        turn, arm, moved = cv2.Rodrigues(base)[0].ravel(), x[3:6], np.ptp(angles, axis=0)
        return MountFit(
            mount=Mount(
                rotation=(float(turn[0]), float(turn[1]), float(turn[2])),
                lever_arm=(float(arm[0]), float(arm[1]), float(arm[2])),
            ),
            deviations=tuple(float(value) for value in spread[:6]),
            error=float(np.sqrt(2 * np.mean(found.fun**2))),
            residuals=found.fun.reshape(-1, 2),
            views=len(stage),
            turn=(float(moved[0]), float(moved[1])),
        )

    def _starts(self, angles: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Rotation vectors to start from: upright and upside down, forwards and, where both axes turn,
        backwards: an axis that turns the wrong way is the same as a camera that looks backwards."""
        starts = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi], [np.pi, 0.0, 0.0], [0.0, np.pi, 0.0]])
        return list(starts if np.ptp(angles, axis=0).min() >= TURNS else starts[:2])

    def _free(self, angles: NDArray[np.float64]) -> NDArray[np.bool_]:
        """What the movement determines: turning about one axis only, a turn about it and a shift along it
        change the mount and the board alike; they are left at 0."""
        free = np.ones(12, dtype=bool)
        pan, tilt = np.ptp(angles, axis=0) >= TURNS
        if not tilt:
            free[[1, 4]] = False
        if not pan:
            free[[0, 3]] = False
        return free

    def _start(self, looking: NDArray[np.float64]) -> NDArray[np.float64]:
        """A camera on the axes, its axes (3, 3) `looking`, and the board where the first view shows it."""
        sighting = self._sightings[0]
        _, turn, move = cv2.solvePnP(sighting.points, sighting.pixels, self._K, self._lens)
        board = cv2.Rodrigues(looking @ cv2.Rodrigues(turn)[0])[0].ravel()
        return np.concatenate([np.zeros(6), board, looking @ move.ravel()])

    def _residuals(
        self,
        x: NDArray[np.float64],
        stage: Sequence[NDArray[np.float64]],
        base: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        mount, board = cv2.Rodrigues(x[:3])[0] @ base, cv2.Rodrigues(x[6:9])[0]
        found = []
        for turned, sighting in zip(stage, self._sightings, strict=True):
            fixed = sighting.points @ board.T + x[9:12]
            seen = (fixed @ turned - x[3:6]) @ mount
            pixels, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), self._K, self._lens)
            found.append((pixels.reshape(-1, 2) - sighting.pixels).ravel())
        return np.concatenate(found)


def _filled(values: NDArray[np.float64], free: NDArray[np.bool_]) -> NDArray[np.float64]:
    x = np.zeros(len(free))
    x[free] = values
    return x
