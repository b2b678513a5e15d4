"""One standard deviation per fused pixel, from the noise of the samples around it and the slope of the map.

    deviation² = (a σ)² / n + (b ‖∇X‖)²,   a² = 0.33² + (0.14 σ / λ)²

n samples of deviation σ lie within one low-resolution pixel; the prior averages over more of them the larger
λ is, but no further than the scene's own structure. On slopes and edges the error is one of place, and b is
in fused pixels. The constants are measured on simulated scenes (tests/solver/test_deviation.py holds them to
it).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.prior import Prior
from solver.problem import Problem, Solution
from solver.sampling import sample

_FLOOR, _NOISE, _PLACE = 0.33, 0.14, 0.21

_SINGLE = ("nearest", "bicubic")
"""Methods that show one frame."""


def deviation(
    problem: Problem, solution: Solution, distance: NDArray[np.float32], away: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(βH, βW) for a filled map; doubled with each low-resolution pixel that the nearest sample is `away`."""
    factor = problem.options.upsampling
    noise = _smoothing(solution) * _sample_deviation(problem, factor)
    fine = np.pad(np.nan_to_num(distance), 2, mode="edge")[None]
    slope = Prior().norms(fine)[2:-2, 2:-2]
    place = np.float32(_PLACE) * cv2.blur(slope, (factor, factor), borderType=cv2.BORDER_REFLECT)
    return np.asarray(np.hypot(noise, place) * np.exp2(np.minimum(away, np.float32(20))), np.float32)


def _smoothing(solution: Solution) -> float:
    if solution.relative is None:
        return 1.0
    return float(np.hypot(_FLOOR, _NOISE / solution.relative))


def _sample_deviation(problem: Problem, factor: int) -> NDArray[np.float32]:
    """σ / √n by fused pixel, samples weighted by their precision."""
    used = np.isfinite(problem.distance)
    usual = float(np.median(problem.sigma[used]))
    if not 0 < usual < np.inf:
        return np.zeros(problem.fused_shape, np.float32)
    precision = np.where(used, (usual / problem.sigma) ** 2, np.float32(0))
    samples = sample(problem.distance, precision, problem.positions, factor)
    near = cv2.blur(samples.weight, (factor, factor), borderType=cv2.BORDER_REFLECT) * np.float32(factor**2)
    if problem.options.method in _SINGLE:
        near /= np.float32(len(problem.distance))
    # Blurred rounding errors are no samples; a hundredth of a sample stands for none.
    return np.asarray(usual / np.sqrt(np.maximum(near, np.float32(0.01))), np.float32)
