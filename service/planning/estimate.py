"""What to expect of a plan before it is run: sub-pixel phases covered, parallax that no rotation undoes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Mount
from drivers.poses import camera_centre, camera_rotation, relative_rotations
from drivers.rotations import rotation_matrix
from service.planning.plan import Plan, coverage

PARALLAX_LIMIT = 0.1
"""Pixels; beyond it errors of position cost the fusion a factor of two to four."""


@dataclass(frozen=True)
class PlanEstimate:
    """What a plan promises.

    Attributes:
        poses: how many.
        upsampling: β of the fusion to come.
        shifts: (N, 2) dy, dx of each pose at the image centre, low-resolution pixels.
        coverage: share of the β × β sub-pixel phases that some pose falls in, at best poses / β².
        rows, columns: share of the β phases along each axis.
        nearest, farthest: metres, between which the scene lies.
        parallax_nearest, parallax_farthest: largest displacement of any pixel by the turning lever arm, over
            what a pure rotation would do, pixels, at those ranges.
        parallax: the largest difference between the two: what registering by rotation leaves.
    """

    poses: int
    upsampling: int
    shifts: NDArray[np.float64]
    coverage: float
    rows: float
    columns: float
    nearest: float
    farthest: float
    parallax_nearest: float
    parallax_farthest: float
    parallax: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know before spending time on it."""
        found = []
        if self.poses > 1:
            for name, share, axis in (("rows", self.rows, "tilt"), ("columns", self.columns, "pan")):
                if share <= 1 / self.upsampling < 1:
                    found.append(
                        f"the {name} stay unresolved: all poses see the same phase of them; use a stage that "
                        f"can {axis} (plan.axes = 'both'), or mount the camera rolled by 45°"
                    )
        if self.parallax > PARALLAX_LIMIT:
            found.append(
                f"the camera's lever arm shifts things at {self.nearest:g} m by {self.parallax:.2f} pixels "
                f"against things at {self.farthest:g} m, more than {PARALLAX_LIMIT:g}: make plan.span "
                "smaller, or mount the camera with its projection centre on the stage's axes"
            )
        return tuple(found)

    def __str__(self) -> str:
        return (
            f"{self.poses} poses cover {100 * self.coverage:.0f} % of the {self.upsampling} × "
            f"{self.upsampling} sub-pixel phases (rows {100 * self.rows:.0f} %, columns "
            f"{100 * self.columns:.0f} %); parallax {self.parallax_nearest:.3f} pixels at "
            f"{self.nearest:g} m, {self.parallax_farthest:.3f} at {self.farthest:g} m"
        )


def estimate_plan(
    plan: Plan, calibration: Calibration, upsampling: int, nearest: float, farthest: float
) -> PlanEstimate:
    """Estimate what `plan` will give with a camera mounted as `calibration` says.

    Args:
        nearest, farthest: metres, between which the scene lies.
    """
    angles = np.array([(pose.pan, pose.tilt) for pose in plan.poses])
    shifts = _shifts(angles, calibration)
    near, far = (_parallax(angles, calibration, distance) for distance in (nearest, farthest))
    return PlanEstimate(
        poses=len(plan),
        upsampling=upsampling,
        shifts=shifts,
        coverage=_coverage(shifts, upsampling),
        rows=_share(shifts[:, 0], upsampling),
        columns=_share(shifts[:, 1], upsampling),
        nearest=nearest,
        farthest=farthest,
        parallax_nearest=_largest(near),
        parallax_farthest=_largest(far),
        parallax=_largest(near - far),
    )


def _shifts(angles: NDArray[np.float64], calibration: Calibration) -> NDArray[np.float64]:
    """(N, 2) dy, dx: where frame 0 sees what each frame sees at its principal point."""
    rays = rotation_matrix(relative_rotations(angles, calibration.mount))[..., 2]
    k = calibration.intrinsics
    return np.stack([k.fy * rays[:, 1] / rays[:, 2], k.fx * rays[:, 0] / rays[:, 2]], axis=1)


def _coverage(shifts: NDArray[np.float64], upsampling: int) -> float:
    """The best over all places of the grid of phases: planned poses lie on its lines, real ones beside."""
    places = (np.arange(8) + 0.5) / 8 / upsampling
    return max(coverage(shifts + np.array([dy, dx]), upsampling) for dy in places for dx in places)


def _share(shifts: NDArray[np.float64], upsampling: int) -> float:
    """Share of `upsampling` phases along one axis; the first pose lies in the middle of its phase."""
    return len(np.unique(np.floor(shifts * upsampling + 0.5) % upsampling)) / upsampling


def _parallax(angles: NDArray[np.float64], calibration: Calibration, distance: float) -> NDArray[np.float64]:
    """(N, 5, 2) pixels by which the moved centre shifts things at `distance`, at the centre and the corners.

    A centre that moved by t, in camera axes, sees a point at depth Z and normalised x displaced by
    f · (t_x − x · t_z) / Z.
    """
    mount, k = calibration.mount, calibration.intrinsics
    moved = np.array([_movement(pan, tilt, angles[0, 0], angles[0, 1], mount) for pan, tilt in angles])
    columns = np.array([k.cx, 0, calibration.width - 1, 0, calibration.width - 1])
    rows = np.array([k.cy, 0, 0, calibration.height - 1, calibration.height - 1])
    places = np.stack([(columns - k.cx) / k.fx, (rows - k.cy) / k.fy], axis=1)
    shift = moved[:, None, :2] - places[None] * moved[:, None, 2:]
    pixels: NDArray[np.float64] = shift * [k.fx, k.fy] / distance
    return pixels


def _movement(pan: float, tilt: float, pan0: float, tilt0: float, mount: Mount) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = camera_rotation(pan0, tilt0, mount).T @ (
        camera_centre(pan, tilt, mount) - camera_centre(pan0, tilt0, mount)
    )
    return moved


def _largest(shifts: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(shifts, axis=-1).max())
