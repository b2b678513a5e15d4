"""One standard deviation per fused pixel, from the noise of the samples around it and the slope of the map.

    deviation² = (a σ)² / n + (b ‖∇X‖)²,   a² = floor² + (share · σ / λ)²

n samples of deviation σ lie within one low-resolution pixel; the prior averages over more of them the larger
λ is, but no further than the scene's own structure. On slopes and edges the error is one of place, and b is
in fused pixels. The constants are measured on simulated scenes (tests/solver/test_deviation.py holds them to
it).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.noise import usual_deviation
from solver.prior import Prior
from solver.problem import Problem, Solution
from solver.sampling import sample

_LEVEL, _SLOPED = (0.33, 0.14, 0.21), {"area": (0.18, 0.03, 0.03), "phasor": (0.17, 0.03, 0.08)}
"""Floor, share of σ / λ, and b: for a prior of first order, and by method for one that lets ramps pass."""

_SINGLE = ("nearest", "bicubic")
"""Methods that show one frame."""


def sample_precision(problem: Problem) -> NDArray[np.float32]:
    """(βH, βW): Σ 1 / σ² of the samples on each fused pixel, relative to the usual sample's; 0 = none."""
    used = np.isfinite(problem.distance)
    if not problem.noise:
        weights = used.astype(np.float32)
    else:
        least = np.float32(np.finfo(np.float32).tiny)
        weights = np.where(
            used, np.maximum((usual_deviation(problem) / problem.sigma) ** 2, least), np.float32(0)
        )
    return sample(problem.distance, weights, problem.positions, problem.options.upsampling).weight


def deviation(
    problem: Problem,
    solution: Solution,
    precision: NDArray[np.float32],
    distance: NDArray[np.float32],
    away: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(βH, βW) for a filled map; doubled with each low-resolution pixel that the nearest sample is `away`."""
    window = (problem.options.upsampling,) * 2
    near = cv2.blur(precision, window, borderType=cv2.BORDER_REFLECT) * np.float32(window[0] ** 2)
    if problem.options.method in _SINGLE:
        near /= np.float32(len(problem.distance))
    # Blurred rounding errors are no samples; a hundredth of a sample stands for none.
    usual = usual_deviation(problem) if problem.noise else 0.0
    floor, share, shift = _SLOPED.get(problem.options.method, _LEVEL)
    relative = solution.relative
    smoothing = 1.0 if relative is None else float(np.hypot(floor, share / relative))
    noise = np.float32(smoothing * usual) / np.sqrt(np.maximum(near, np.float32(0.01)))
    fine = np.pad(distance, 2, mode="edge")[None]
    place = np.float32(shift) * cv2.blur(
        Prior().norms(fine)[2:-2, 2:-2], window, borderType=cv2.BORDER_REFLECT
    )
    spread = np.hypot(noise, place)
    beyond = away > 0
    spread[beyond] *= np.exp2(np.minimum(away[beyond], np.float32(20)))
    return np.asarray(spread, np.float32)
