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
