"""Radial counts from the Cartesian points that the SR4000's library delivers."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import COUNTS_PER_RANGE, ambiguity_range

ORIGIN_BEFORE_CENTRE = 0.010
"""Metres from the projection centre to the vendor's origin: Z = r · cos − 0.010 (measured on real frames)."""

SIGNIFICANT_BITS = 14
"""Of the SR4000's 16-bit counts: r comes in steps of 5 m / 16384 = 0.305 mm (measured on real frames)."""

ON_STEPS = 0.2
"""Steps; root mean square distance from the nearest one. 0.13 on real frames, whose text is rounded to
0.1 mm; 1/√12 = 0.29 where there are no steps, or others."""

LEAST_RANGE = 0.5
"""Metres; nearer points are too coarse for their direction to be compared."""

Points = NDArray[np.float64]


def radial_counts(
    x: Points, y: Points, z: Points, confidence: NDArray[np.float64], frequency: float, origin: Path
) -> NDArray[np.uint16]:
    """Counts of each pixel's radial distance.

    Args:
        x, y, z: (H, W) metres in the vendor's axes: x to the image's left, y up, z forward, origin 10 mm in
            front of the projection centre.
        confidence: (H, W), 0 = the camera could not tell: the pixel is rejected.
        frequency: modulation frequency, Hz.
        origin: the file, for messages.

    Returns:
        (H, W) uint16. Rounded to the camera's own steps where the distances lie on them, so that they are
        the very counts that it measured; to one count otherwise.

    Raises:
        RecordingError: a distance beyond the ambiguity range.
    """
    reach = ambiguity_range(frequency)
    radius = np.sqrt(x**2 + y**2 + (z + ORIGIN_BEFORE_CENTRE) ** 2)
    usable = (confidence > 0) & np.isfinite(radius)
    step = 1 << (16 - SIGNIFICANT_BITS)
    exact = np.where(usable, radius, 0.0) * (COUNTS_PER_RANGE / reach)
    off = exact[usable] / step
    if off.size and np.sqrt(np.mean((off - np.round(off)) ** 2)) > ON_STEPS:
        step = 1
    counts = np.round(exact / step) * step
    if counts.max(initial=0) >= COUNTS_PER_RANGE:
        farthest = radius[usable].max()
        raise RecordingError(
            f"{origin}: a point is {farthest:.3f} m away, beyond the {reach:.3f} m that can be told apart at "
            f"{frequency / 1e6:g} MHz: say at which frequency the camera ran"
        )
    return counts.astype(np.uint16)


def direction_error(x: Points, y: Points, z: Points, calibration: Calibration) -> float | None:
    """Pixels, median, between where points are seen and where the calibration projects them.

    None where there is no point to compare.
    """
    import cv2

    points = np.stack([-x, -y, z + ORIGIN_BEFORE_CENTRE], axis=-1)
    usable = np.isfinite(points).all(axis=-1) & (points[..., 2] > LEAST_RANGE)
    if not usable.any():
        return None
    seen = np.stack(np.meshgrid(np.arange(x.shape[1]), np.arange(x.shape[0])), axis=-1)[usable]
    projected, _ = cv2.projectPoints(
        points[usable].reshape(-1, 1, 3),
        np.zeros(3),
        np.zeros(3),
        calibration.intrinsics.matrix,
        np.asarray(calibration.distortion or (0.0,) * 5),
    )
    return float(np.median(np.linalg.norm(projected.reshape(-1, 2) - seen, axis=1)))


def whole_amplitude(amplitude: NDArray[np.float64], origin: Path) -> NDArray[np.uint16]:
    """(H, W) uint16; raises `RecordingError` where values are not counts."""
    if not (np.isfinite(amplitude).all() and amplitude.min() >= 0 and amplitude.max() <= 0xFFFF):
        raise RecordingError(
            f"{origin}: amplitudes run from {amplitude.min():g} to {amplitude.max():g}; expected 0 to 65535"
        )
    return np.round(amplitude).astype(np.uint16)
