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
        self._sources = _sources(calibration) if any(calibration.distortion) else None

    def __call__(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """(H, W) float32, NaN where the lens does not see; the image itself without distortion."""
        import cv2

        if self._sources is None:
            return image
        found: Any = cv2.remap(
            image,
            self._sources,
            np.empty(0, np.int16),  # fractions of pixels, which the nearest sample has none of
            cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(np.nan,) * 4,
        )
        return np.asarray(found)


def _sources(calibration: Calibration) -> NDArray[np.int16]:
    """(H, W, 2) column and row of each rectified pixel in the distorted image (OpenCV's lens model)."""
    import cv2

    K, lens = calibration.intrinsics.matrix, np.array(calibration.distortion)
    height, width = calibration.shape
    columns, rows = cv2.initUndistortRectifyMap(K, lens, np.eye(3), K, (width, height), cv2.CV_32FC1)
    limit = np.iinfo(np.int16)
    return np.rint(np.dstack([columns, rows])).clip(limit.min, limit.max).astype(np.int16)
