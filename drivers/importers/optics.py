"""A camera's own optics from the points that it delivers.

Each pixel's x, y, z lie on the ray that the camera's calibration gives it, whatever the scene: one frame
fixes focal length, principal point and radial distortion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Intrinsics
from drivers.errors import RecordingError

LEAST_POINTS = 2000
"""Of 25,344; fewer, or points in a corner of the image, leave focal length and distortion open."""

LEAST_SPAN = 0.7
"""Of rows and of columns that the points must span."""

TERMS = 3
"""Radial terms at most: k1, k2, k3 of OpenCV's model."""

LEAST_GAIN = 0.15
"""A further term must lower the residual by this part. The third lowers that of one real SR4000 by a fifth
and its worst error from 1.4 to 0.5 mm; that of another by a ninth, and its worst error not at all."""

WORST_RESIDUAL, COARSEST = 0.1, 0.6e-3
"""Pixels and metres aside: where both are exceeded the points do not come from one lens. 0.01 to 0.02 pixels
on real frames; coordinates in whole millimetres miss by 0.3 mm."""

OUTLIER = 9.0
"""Times the median miss, six standard deviations: such points are left out of the fit, so that damaged
numbers do not bend the lens."""

NO_OUTLIER = 0.5
"""Pixels; a point that misses by less is none, however well the others fit."""


@dataclass(frozen=True, slots=True)
class Optics:
    """Focal length (pixels), principal point (column, row) and radial distortion (OpenCV's k1, k2, k3).

    Attributes:
        residual: pixels, root mean square in each direction, of the points that were kept.
    """

    focal_length: float
    centre: tuple[float, float]
    radial: tuple[float, ...]
    residual: float

    def calibration(self, model: Calibration, source: str) -> Calibration:
        """The calibration of a camera's model with these optics in place of its own."""
        k1, k2, k3 = (*self.radial, 0.0, 0.0, 0.0)[:3]
        x, y = self.centre
        return model.model_copy(
            update={
                "intrinsics": Intrinsics(fx=self.focal_length, fy=self.focal_length, cx=x, cy=y),
                "distortion": (k1, k2, 0.0, 0.0, k3),
                "source": source,
            }
        )


def fit_optics(points: NDArray[np.float64], usable: NDArray[np.bool_]) -> Optics | None:
    """Linear least squares for pixel = f · direction · (1 + k1 r² + k2 r⁴ + k3 r⁶) + centre.

    Args:
        points: (H, W, 3) metres in camera axes: x right, y down, z forward.
        usable: (H, W), which of them to fit.

    Returns:
        None where too few points, or too small a part of the image, leave the optics open.

    Raises:
        RecordingError: the points do not come from one lens, or its axes are others.
    """
    if not _spread(usable):
        return None
    pixels = np.argwhere(usable)[:, ::-1].astype(np.float64)
    directions = points[usable][:, :2] / points[usable][:, 2:]
    missed = np.abs(_project(directions, _solve(directions, pixels, TERMS)) - pixels).max(axis=1)
    kept = missed <= max(OUTLIER * float(np.median(missed)), NO_OUTLIER)
    directions, pixels = directions[kept], pixels[kept]
    best = _fitted(directions, pixels, 0)
    for terms in range(1, TERMS + 1):
        finer = _fitted(directions, pixels, terms)
        if finer.residual > (1 - LEAST_GAIN) * best.residual:
            break
        best = finer
    aside = best.residual * float(np.median(points[usable][:, 2])) / best.focal_length
    if best.residual > WORST_RESIDUAL and aside > COARSEST:
        raise RecordingError(
            f"x, y, z do not come from one lens: at best they miss their pixels by {best.residual:.2f} pixels"
        )
    return best


def _spread(usable: NDArray[np.bool_]) -> bool:
    if usable.sum() < LEAST_POINTS:
        return False
    spans = (np.ptp(places) / (size - 1) for places, size in zip(usable.nonzero(), usable.shape, strict=True))
    return all(span >= LEAST_SPAN for span in spans)


def _fitted(directions: NDArray[np.float64], pixels: NDArray[np.float64], terms: int) -> Optics:
    found = _solve(directions, pixels, terms)
    if found[0] <= 0:
        raise RecordingError("x and y do not run to the left and up, as the vendor's do")
    residual = float(np.sqrt(np.mean((_project(directions, found) - pixels) ** 2)))
    return Optics(
        focal_length=float(found[0]),
        centre=(float(found[-2]), float(found[-1])),
        radial=tuple(float(k) for k in found[1:-2] / found[0]),
        residual=residual,
    )


def _solve(directions: NDArray[np.float64], pixels: NDArray[np.float64], terms: int) -> NDArray[np.float64]:
    """f, f·k1, …, then the centre's column and row."""
    radial = _radial(directions, terms)
    equations = np.zeros((2, len(directions), terms + 3))
    for axis in (0, 1):
        equations[axis, :, :-2] = directions[:, axis, None] * radial
        equations[axis, :, axis - 2] = 1.0
    found = np.linalg.lstsq(equations.reshape(-1, terms + 3), pixels.T.ravel(), rcond=None)[0]
    return found.astype(np.float64)


def _project(directions: NDArray[np.float64], found: NDArray[np.float64]) -> NDArray[np.float64]:
    scale = _radial(directions, len(found) - 3) @ found[:-2]
    projected: NDArray[np.float64] = directions * scale[:, None] + found[-2:]
    return projected


def _radial(directions: NDArray[np.float64], terms: int) -> NDArray[np.float64]:
    """(N, terms + 1): powers of r²."""
    squares = (directions**2).sum(axis=1)
    return np.stack([squares**power for power in range(terms + 1)], axis=1)
