"""Flat walls as a camera sees them: which pixels show one, how well, and the plane through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from service.calibration.still import Still
from service.errors import CalibrationError

OUTLIER = 4.0
"""Robust deviations from the wall at which a pixel is taken for something else than wall."""

LEAST_SHARE = 0.3
"""Of the image that has to show the wall."""


@dataclass(frozen=True)
class Wall:
    """One flat wall.

    Attributes:
        still: the mean of its frames.
        distance: perpendicular distance from the camera's projection centre, metres, or None.
    """

    still: Still
    distance: float | None


def wall_pixels(
    rays: NDArray[np.float64], distance: NDArray[np.float64], weight: NDArray[np.float64], number: int
) -> NDArray[np.bool_]:
    """(H, W) pixels within the noise and the systematic errors of the flat wall, the `number`th of all.

    Raises:
        CalibrationError: too few of them.
    """
    measured = np.isfinite(distance) & (weight > 0)
    on = measured
    for _ in range(10):
        if on.mean() < LEAST_SHARE:
            raise CalibrationError(
                f"wall {number}: {100 * on.mean():.0f} % of the image show one flat wall, at least "
                f"{100 * LEAST_SHARE:.0f} % are needed: fill the view with it"
            )
        plane = plane_through(rays[on], distance[on], weight[on])
        error = np.abs(distance - 1 / (rays @ plane)) * np.sqrt(weight)
        keep = measured & (error < OUTLIER * float(np.median(error[on])) / 0.6745)
        if (keep == on).all():
            break
        on = keep
    return on


def weights_of(still: Still) -> NDArray[np.float64]:
    """(H, W) 1 / variance against a pixel of median brightness, at most 1; 0 where nothing was measured.

    σ ∝ 1 / amplitude; brighter pixels are no better, since systematic errors are left in them. All are alike
    where the camera gives no amplitude.
    """
    if still.amplitude is None:
        return np.isfinite(still.distance).astype(np.float64)
    bright = np.nan_to_num(still.amplitude, nan=0.0)
    middle = float(np.median(bright[bright > 0])) if np.any(bright > 0) else 1.0
    weight: NDArray[np.float64] = np.minimum(1.0, (bright / middle) ** 2)
    return weight


def rays_of(calibration: Calibration) -> NDArray[np.float64]:
    """(H, W, 3) unit rays of the pixels, camera axes."""
    from solver.geometry.lens import pixel_rays

    slopes = pixel_rays(calibration.shape, calibration.intrinsics.matrix, calibration.distortion)
    rays = np.concatenate([slopes[..., :2], np.ones((*calibration.shape, 1))], axis=2)
    unit: NDArray[np.float64] = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    return unit


def plane_through(
    rays: NDArray[np.float64], distance: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3,) q of the plane through the points distance · ray, by least squares of distance · (q · ray) = 1."""
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(rays * (distance * root)[:, None], root, rcond=None)[0])
