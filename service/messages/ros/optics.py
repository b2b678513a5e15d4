"""What follows from the optics of images, found once for all images that share them."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from service.messages.ros.rectification import Rectification
from solver.geometry.points import depth_from_distance


class Optics:
    """Of images of one calibration.

    Attributes:
        calibration: of the images.
        straight: of the rectified ones.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self.straight = calibration.model_copy(update={"distortion": ()})
        self.rectify = Rectification(calibration)

    @cached_property
    def depth_of_distance(self) -> NDArray[np.float32]:
        """(H, W) depth of a distance of 1."""
        ones = np.ones(self.calibration.shape, dtype=np.float32)
        lens = self.calibration.distortion or None
        return depth_from_distance(ones, self.calibration.intrinsics.matrix, lens)
