"""Which distances of a phasor map to believe.

Where the light fades, angle(Z) is noise; beside a bright edge, the sharpened Z of a dark surface may swing
past 0, and its angle then points half the ambiguity range away. No surface lies outside the distances
measured around it, so what does is not believed, and neither is anything without light around it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import sparse as kernels
from solver.kernels import team
from solver.problem import Problem

_LEAST_LIGHT = 40.0
"""A sample whose deviation is over a fortieth of the ambiguity range says nothing of use."""

_MARGIN = 3.0
"""Deviations of the usual sample by which a distance may leave the range of those around it."""


def around(
    problem: Problem, usual: float, ambiguity_range: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(H, W) twice: the least and the largest distance to believe within each low-resolution pixel.

    They are those of the lit samples one and a half pixels around, less and plus a margin; `usual` is the
    deviation of the usual sample, in the unit of distance.
    """
    low = np.full(problem.distance.shape[1:], np.inf, np.float32)
    high = np.full_like(low, -np.inf)
    most = np.float32(ambiguity_range / _LEAST_LIGHT)
    team.share(kernels.extremes, problem.distance, problem.sigma, most, problem.positions, low, high)
    window = np.ones((3, 3), np.uint8)
    margin = np.float32(_MARGIN * usual)
    return np.asarray(cv2.erode(low, window)) - margin, np.asarray(cv2.dilate(high, window)) + margin
