"""Radial counts from the Cartesian points that the SR4000's library delivers."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import COUNTS_PER_RANGE, ambiguity_range

ORIGIN_BEFORE_CENTRE = 0.010
"""Metres from the projection centre to the vendor's origin: Z = r · cos − 0.010 (measured on real frames of
two cameras)."""

SIGNIFICANT_BITS = 14
"""Of the SR4000's 16-bit counts: r comes in steps of 5 m / 16384 = 0.305 mm (measured on real frames)."""

ON_STEPS = 0.2
"""Steps; root mean square distance from the nearest one. 0.13 on real frames, whose text is rounded to
0.1 mm; 1/√12 = 0.29 where there are no steps, or others."""

LEAST_RANGE = 0.5
"""Metres; nearer points are too coarse for their direction to be compared."""

WIDEST = 4.0
"""Tangent of an angle that no lens of these cameras sees."""

Points = NDArray[np.float64]


def camera_points(x: Points, y: Points, z: Points) -> Points:
    """(H, W, 3) in camera axes from the vendor's: x to the image's left, y up, origin before the centre."""
    return np.stack([-x, -y, z + ORIGIN_BEFORE_CENTRE], axis=-1)


def comparable(points: Points, trusted: NDArray[np.bool_], nearest: float = LEAST_RANGE) -> NDArray[np.bool_]:
    """(H, W), the points from `nearest` metres on of which the direction can be told."""
    far = points[..., 2]
    known: NDArray[np.bool_] = trusted & np.isfinite(points).all(axis=-1) & (far > nearest)
    known[known] &= (np.abs(points[known][:, :2]) < WIDEST * points[known][:, 2:]).all(axis=1)
    return known


def direction_error(points: Points, known: NDArray[np.bool_], calibration: Calibration) -> Points:
    """(H, W) pixels between where points are seen and where they are projected; NaN = not `known`."""
    error = np.full(known.shape, np.nan)
    if known.any():
        projected, _ = cv2.projectPoints(
            points[known].reshape(-1, 1, 3),
            np.zeros(3),
            np.zeros(3),
            calibration.intrinsics.matrix,
            np.asarray(calibration.distortion or (0.0,) * 5),
        )
        error[known] = np.linalg.norm(projected.reshape(-1, 2) - np.argwhere(known)[:, ::-1], axis=1)
    return error


def cosines(calibration: Calibration) -> Points:
    """(H, W) cosine of the angle between each pixel's ray and the optical axis."""
    pixels = np.argwhere(np.ones(calibration.shape, bool))[:, ::-1].astype(np.float64)
    rays = cv2.undistortPoints(
        pixels.reshape(-1, 1, 2),
        calibration.intrinsics.matrix,
        np.asarray(calibration.distortion or (0.0,) * 5),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    )
    cosine: Points = 1.0 / np.sqrt(1.0 + (rays.reshape(*calibration.shape, 2) ** 2).sum(axis=-1))
    return cosine


def radial_counts(
    radius: Points, trusted: NDArray[np.bool_], frequency: float, origin: Path
) -> NDArray[np.uint16]:
    """Counts of each pixel's radial distance.

    Args:
        radius: (H, W) metres from the projection centre.
        trusted: (H, W), the others are rejected.
        frequency: modulation frequency, Hz.
        origin: the file, for messages.

    Returns:
        (H, W) uint16, 0 = rejected. Rounded to the camera's own steps where the distances lie on them, so
        that they are the very counts that it measured; to one count otherwise.

    Raises:
        RecordingError: a distance beyond the ambiguity range.
    """
    reach = ambiguity_range(frequency)
    usable = trusted & np.isfinite(radius)
    farthest = radius[usable].max(initial=0.0)
    step = 1 << (16 - SIGNIFICANT_BITS)
    exact = np.where(usable, np.minimum(radius, 2 * reach), 0.0) * (COUNTS_PER_RANGE / reach)
    off = exact[usable] / step
    if off.size and np.sqrt(np.mean((off - np.round(off)) ** 2)) > ON_STEPS:
        step = 1
    counts = np.round(exact / step) * step
    if counts.max(initial=0) >= COUNTS_PER_RANGE:
        raise RecordingError(
            f"{origin}: a point is {farthest:.4g} m away, beyond the {reach:.3f} m that can be told apart at "
            f"{frequency / 1e6:g} MHz: say at which frequency the camera ran (--frequency), or the file is "
            "damaged or of another kind"
        )
    return counts.astype(np.uint16)


def whole_amplitude(amplitude: Points, origin: Path) -> NDArray[np.uint16]:
    """(H, W) uint16, 0 where there is none; raises `RecordingError` where values are not counts."""
    known = amplitude[np.isfinite(amplitude)]
    if known.min(initial=0.0) < 0 or known.max(initial=0.0) > 0xFFFF:
        raise RecordingError(
            f"{origin}: amplitudes run from {known.min():g} to {known.max():g}; expected 0 to 65535"
        )
    return np.round(np.nan_to_num(amplitude, posinf=0.0, neginf=0.0)).astype(np.uint16)
