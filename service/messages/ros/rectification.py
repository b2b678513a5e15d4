"""Rectified images: what a lens without distortion would show."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration


class Rectification:
    """Takes the lens distortion out of images; each pixel is its nearest sample, so that edges stay sharp.

    Args:
        calibration: of the images; the rectified ones have the same intrinsics.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self._source = _sources(calibration) if any(calibration.distortion) else None

    def __call__(self, image: NDArray[Any]) -> NDArray[Any]:
        """(H, W) float32, NaN where the lens does not see; the image itself without distortion."""
        if self._source is None:
            return image
        inside, place = self._source
        return np.where(inside, image.ravel()[place], np.float32(np.nan)).astype(image.dtype, copy=False)


def _sources(calibration: Calibration) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Whether each rectified pixel is seen, and where in the distorted image (OpenCV's lens model)."""
    import cv2

    K, lens = calibration.intrinsics.matrix, np.array(calibration.distortion)
    height, width = calibration.shape
    columns, rows = cv2.initUndistortRectifyMap(K, lens, np.eye(3), K, (width, height), cv2.CV_32FC1)
    column, row = np.rint(columns).astype(np.intp), np.rint(rows).astype(np.intp)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return inside, np.where(inside, row * width + column, 0)
