"""Where the camera looks in the course of one burst: poses whose sub-pixel phases are evenly spread."""

from dataclasses import dataclass
from functools import cached_property
from math import atan, radians

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.calibration import Intrinsics
from drivers.errors import LimitError
from drivers.position import Limits, Position
from service.config.sections import PlanSection
from service.errors import PlanError

_UNSEEN = 0.02
"""Pixels: errors of a phase below what registration resolves do not decide where a pose lies."""


@dataclass(frozen=True)
class Plan:
    """The poses of one burst.

    Attributes:
        offsets: (N, 2) float64, (dy, dx) by which each pose moves the view, low-resolution pixels at the
            image centre; the first is (0, 0).
        centre: stage angles of the first pose, radians.
        intrinsics: of the camera, in low-resolution pixels.
    """

    offsets: NDArray[np.float64]
    centre: Position
    intrinsics: Intrinsics

    def __len__(self) -> int:
        return len(self.offsets)

    @property
    def moves(self) -> bool:
        """Whether the poses differ."""
        return bool(np.any(self.offsets))

    @cached_property
    def poses(self) -> tuple[Position, ...]:
        """Stage angles of each pose: dx = −fx · tan(pan), dy = −fy · tan(tilt) about the centre."""
        return tuple(
            Position(
                self.centre.pan - atan(dx / self.intrinsics.fx),
                self.centre.tilt - atan(dy / self.intrinsics.fy),
            )
            for dy, dx in self.offsets
        )

    def check(self, limits: Limits) -> None:
        """Raise `PlanError` unless the stage can reach every pose."""
        for number, pose in enumerate(self.poses):
            try:
                limits.check(pose.pan, pose.tilt)
            except LimitError as error:
                raise PlanError(f"pose {number} of the plan cannot be reached: {error}") from error


def make_plan(
    settings: PlanSection,
    frames: int,
    intrinsics: Intrinsics,
    *,
    upsampling: int = 4,
    resolution: float = 0.0,
    still: bool = False,
) -> Plan:
    """A plan of `frames` poses.

    Their phases form a rank-1 lattice, the most even arrangement of a known number of points on the torus
    (Niederreiter 1992, ch. 5). Whole pixels are then added so that the poses fill the span as well, and so
    that rounding to the stage's steps moves the phases little.

    Args:
        settings: span, axes, and the angles of the centre.
        frames: number of poses.
        intrinsics: of the camera, low-resolution pixels.
        upsampling: β of the fusion to come.
        resolution: the stage's smallest step, radians; 0 = continuous.
        still: the camera does not turn: the same pose each time.
    """
    centre = Position(radians(settings.pan), radians(settings.tilt))
    if still or frames == 1 or settings.span == 0:
        return Plan(np.zeros((frames, 2)), centre, intrinsics)
    if settings.axes == "both":
        phases = lattice(frames, upsampling)
    else:
        phases = np.stack([np.zeros(frames), np.arange(frames) / frames], axis=1)
    # The R2 sequence (Roberts 2018): it fills the span evenly and begins at its centre.
    aims = ((0.5 + np.arange(frames)[:, None] * [0.7548776662, 0.5698402910]) % 1.0 - 0.5) * settings.span
    steps = resolution * np.array([intrinsics.fy, intrinsics.fx])
    axes = (1,) if settings.axes == "pan" else (0, 1)
    offsets = np.zeros((frames, 2))
    for axis in axes:
        offsets[:, axis] = _spread(phases[:, axis], aims[:, axis], settings.span, steps[axis])
    return Plan(_short_way(offsets), centre, intrinsics)


def lattice(count: int, upsampling: int) -> NDArray[np.float64]:
    """(count, 2) points k · (1, g) / count mod 1.

    Among the g that keep the points nearly farthest apart (within 15 %), the one that hits most cells.
    """
    if count == 1:
        return np.zeros((1, 2))
    choices: list[NDArray[np.float64]] = [
        np.arange(count)[:, None] * np.array([1, g]) / count % 1.0 for g in range(1, count)
    ]
    apart = [float(np.hypot(*(points[1:] - np.round(points[1:])).T).min()) for points in choices]
    good = [k for k in range(len(choices)) if apart[k] > 0.85 * max(apart)]
    return choices[max(good, key=lambda k: (coverage(choices[k], upsampling), round(apart[k], 9)))]


def coverage(shifts: ArrayLike, upsampling: int) -> float:
    """Share of the β × β sub-pixel cells that at least one frame falls in.

    Args:
        shifts: (N, 2) displacements (dy, dx), low-resolution pixels.
        upsampling: β.
    """
    moved = np.asarray(shifts, dtype=np.float64)
    moved = moved[np.isfinite(moved).all(axis=1)]
    # The pixel centre (i + ½ + dy) · β falls into cell floor(...); the whole pixel i does not matter.
    cells = np.floor((moved + 0.5) % 1.0 * upsampling).astype(np.int64)
    return len({tuple(cell) for cell in cells.tolist()}) / upsampling**2


def _spread(
    phases: NDArray[np.float64], aims: NDArray[np.float64], span: float, step: float
) -> NDArray[np.float64]:
    """One coordinate of each pose, within ±span/2, with these phases as nearly as steps of `step` allow."""
    if span <= 1:
        offsets = (phases - np.round(phases)) * span  # less than a pixel: the phases share what there is
        if not step:
            return offsets
        reached = np.round(offsets / step) * step
        return np.where(np.abs(reached) <= span / 2, reached, np.trunc(offsets / step) * step)
    found = np.zeros(len(phases))
    for k, (phase, aim) in enumerate(zip(phases, aims, strict=True)):
        candidates = phase + np.arange(np.ceil(-span / 2 - phase), np.floor(span / 2 - phase) + 1)
        reached = np.round(candidates / step) * step if step else candidates
        inside = np.abs(reached) <= span / 2
        error = np.abs(reached - candidates) // _UNSEEN
        found[k] = reached[np.lexsort((np.abs(candidates - aim), error, ~inside))[0]]
    found[0] = 0.0
    return found


def _short_way(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """The offsets in an order with short movements: from the first, always on to the nearest."""
    rest = list(range(1, len(offsets)))
    order = [0]
    while rest:
        here = offsets[order[-1]]
        following = min(rest, key=lambda k: float(np.hypot(*(offsets[k] - here))))
        rest.remove(following)
        order.append(following)
    return offsets[order]
