"""Why each fused pixel has the distance it has, or none."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import votes as kernels
from solver.preparation.problem import Problem

MEASURED, FILLED, DARK, SATURATED, CONTRADICTED, OUTSIDE = range(6)
"""Known from samples, filled from the pixels around; unknown: too little light, too much, frames that
contradict each other, or no sample that looks there."""


def reasons(problem: Problem, distance: NDArray[np.float32], away: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(βH, βW) for a filled map.

    Args:
        distance: NaN where it is unknown.
        away: fused pixels to the nearest one that is known from samples.
    """
    factor = problem.options.upsampling
    out = np.where(away > factor, np.uint8(FILLED), np.uint8(MEASURED))
    unknown = np.isnan(distance)
    if unknown.any():
        causes = _causes(problem)
        out[unknown] = causes.repeat(factor, axis=0).repeat(factor, axis=1)[unknown]
    return out


def _causes(problem: Problem) -> NDArray[np.uint8]:
    """(H, W): what most samples that look at a pixel of the grid lack."""
    used, light = problem.distance, problem.amplitude
    measured = used if problem.consensus is None else problem.consensus.measured
    if light is None:
        light, most = np.zeros_like(used), np.inf
    else:
        valid = np.isfinite(measured)
        most = float(light[valid].max()) if valid.any() else np.inf
    votes = np.zeros((3, *used.shape[1:]), np.int32)
    kernels.vote(used, measured, light, np.float32(most), problem.positions, votes)
    causes = np.array([DARK, SATURATED, CONTRADICTED], np.uint8)[votes.argmax(axis=0)]
    return np.where(votes.any(axis=0), causes, np.uint8(OUTSIDE))
