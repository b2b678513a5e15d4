"""Which distances of a phasor map to believe.

Where the light fades, angle(Z) is noise; beside a bright edge, the sharpened Z of a dark surface may swing
past 0, and its angle then points half the ambiguity range away. No surface lies outside the distances
measured around it, so what does is not believed, and neither is anything without light around it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import sparse as kernels
from solver.problem import Problem

_LEAST_LIGHT = 40.0
"""A sample whose deviation is over a fortieth of the ambiguity range says nothing of use."""

_MARGIN = 3.0
"""Deviations of the usual sample by which a distance may leave the range of those around it."""


def plausible(
    problem: Problem, distance: NDArray[np.float32], usual: float, ambiguity_range: float
) -> NDArray[np.bool_]:
    """(βH, βW): whether each distance lies within those of the lit samples one and a half pixels around.

    `usual` is the deviation of the usual sample, in the unit of distance.
    """
    lit = np.isfinite(problem.distance) & (problem.sigma <= ambiguity_range / _LEAST_LIGHT)
    low = np.full(problem.distance.shape[1:], np.inf, np.float32)
    high = np.full_like(low, -np.inf)
    kernels.extremes(problem.distance, lit, problem.positions, low, high)
    around = np.ones((3, 3), np.uint8)
    least, most = cv2.erode(low, around), cv2.dilate(high, around)
    shape = problem.fused_shape[::-1]
    least = cv2.resize(least, shape, interpolation=cv2.INTER_NEAREST)
    most = cv2.resize(most, shape, interpolation=cv2.INTER_NEAREST)
    margin = np.float32(_MARGIN * usual)
    return np.asarray((distance >= least - margin) & (distance <= most + margin))
