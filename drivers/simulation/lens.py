"""Where pixels behind a distorting lens look: as places in the image that a camera without it would have."""

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration

ITERATIONS, EXACT = 60, 1e-10
"""OpenCV inverts its lens model by iteration."""


def straightened(places: NDArray[np.float64], calibration: Calibration) -> NDArray[np.float64]:
    """(…, 2) columns and rows without distortion, for such with it."""
    if not any(calibration.distortion):
        return places
    import cv2

    K, lens = calibration.intrinsics.matrix, np.array(calibration.distortion)
    points = np.ascontiguousarray(places.reshape(-1, 1, 2), dtype=np.float64)
    end = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, ITERATIONS, EXACT)
    found = cv2.undistortPoints(points, K, lens, P=K, criteria=end)
    return np.asarray(found, dtype=np.float64).reshape(places.shape)


def footprint_places(calibration: Calibration) -> NDArray[np.float64]:
    """(H, W, 5, 5, 2) column and row, without distortion, of a lattice over each pixel's sensitive square."""
    height, width = calibration.shape
    steps = np.linspace(-0.5, 0.5, 5) * calibration.footprint.fill_factor
    rows, columns = (np.arange(n)[:, None] + steps for n in (height, width))
    lattice = np.empty((height, width, 5, 5, 2))
    lattice[..., 0] = columns[None, :, None, :]
    lattice[..., 1] = rows[:, None, :, None]
    return straightened(lattice, calibration)
