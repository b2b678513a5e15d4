"""One standard deviation per fused pixel, from the noise of the samples around it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.problem import Problem
from solver.sampling import sample


def deviation(problem: Problem, away: NDArray[np.float32]) -> NDArray[np.float32]:
    """(βH, βW): σ / √n of the samples within one low-resolution pixel.

    It grows with the distance `away` (in low-resolution pixels) to the nearest sample.
    """
    factor = problem.options.upsampling
    used = np.isfinite(problem.distance)
    usual = float(np.median(problem.sigma[used]))
    if not 0 < usual < np.inf:
        return np.zeros(problem.fused_shape, np.float32)
    precision = np.where(used, (usual / problem.sigma) ** 2, np.float32(0))
    samples = sample(problem.distance, precision, problem.positions, factor)
    near = cv2.blur(samples.weight, (factor, factor), borderType=cv2.BORDER_REFLECT)
    # Blurred rounding errors are no samples; a hundredth of a sample stands for none.
    spread = usual / np.sqrt(np.maximum(near * np.float32(factor**2), np.float32(0.01)))
    return np.asarray(spread * (1 + away), np.float32)
