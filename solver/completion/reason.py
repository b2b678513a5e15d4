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
    unknown = np.flatnonzero(np.isnan(distance))
    if unknown.size:
        rows, columns = np.divmod(unknown, distance.shape[1])
        out.flat[unknown] = _causes(problem, rows // factor, columns // factor)
    return out


def _causes(problem: Problem, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.uint8]:
    """(n,): what most samples that look at each of these pixels of the grid lack."""
    used = problem.distance
    measured = used if problem.consensus is None else problem.consensus.measured
    light = np.zeros_like(used) if problem.amplitude is None else problem.amplitude
    asked = np.zeros(used.shape[1:], np.bool_)
    asked[rows, columns] = True
    votes = np.zeros((3, *asked.shape), np.int32)
    kernels.vote(used, measured, light, problem.positions, asked, votes)
    cast = votes[:, rows, columns]
    causes = np.array([DARK, SATURATED, CONTRADICTED], np.uint8)[cast.argmax(axis=0)]
    return np.where(cast.any(axis=0), causes, np.uint8(OUTSIDE))
