"""`ibsr`: image superresolution applied to depth: L1 data term, bilateral total variation, steepest descent.

    E(X) = ‖A (H X − Z)‖₁ + λ Σ_{l,m = −P..P} α^{|l|+|m|} ‖X − S_x^l S_y^m X‖₁
    X ← X − β { Hᵀ A sign(H X − Z) + λ Σ α^{|l|+|m|} (I − S_x^{−l} S_y^{−m}) sign(X − S_x^l S_y^m X) }

Z is the median shift-and-add map, A the square root of the number of samples at each pixel, H the blur of the
point spread function. Sources: Farsiu, Robinson, Elad, Milanfar, "Fast and Robust Multiframe Super
Resolution", IEEE TIP 13(10), 2004; Schuon, Theobalt, Davis, Thrun, "High-quality scanning using
time-of-flight depth superresolution", CVPR workshops 2008; the settings are those of the LidarBoost paper
(CVPR 2009), whose λ is 0.04; `auto` is another one.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels.bilateral import bilateral, bilateral_value
from solver.methods.shift_and_add import cells
from solver.optimisation.fill import nearest
from solver.preparation.problem import Problem, Solution
from solver.result import Progress

Image = NDArray[np.float32]

ITERATIONS, ALPHA, STEP, REACH = 50, 0.7, 1.0, 5
RANGE = 182.0  # the step is fixed in units of depth, and the paper's object spans 0..182
LEAST, NOISE = 0.02, 10.0
"""λ of `auto` = 0.02 √(1 + (σ / 10)²), the scene's range being 182; the paper's 0.04
smooths more than is best."""
PSF = np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25]).astype(np.float32)  # Gaussian 3 × 3


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Fifty steps from the shift-and-add map; the objective is that of the distance rescaled to 0..182."""
    median, count = cells(problem).medians(problem.distance)
    seen = count > 0
    if not seen.any():
        return Solution(median, None, None, 0, None, None, True)
    low, high = float(median[seen].min()), float(median[seen].max())
    scale = RANGE / (high - low) if high > low else 1.0
    target = np.where(seen, (median - low) * scale, 0).astype(np.float32)
    image = nearest(target, seen)
    if initial is not None:
        known = np.isfinite(initial.distance)
        image = np.where(known, (initial.distance - low) * scale, image).astype(np.float32)
    given = problem.options.regularization
    strength = _automatic(problem) if given == "auto" else float(given)
    root = np.sqrt(count).astype(np.float32)
    steps = min(ITERATIONS, problem.options.max_iterations)
    for step in range(steps):
        if progress is not None and step % 10 == 0:
            progress(step, _objective(image, target, root, strength), None)
        image -= np.float32(STEP) * _slope(image, target, root, strength)
    return Solution(
        image / np.float32(scale) + np.float32(low),
        None,
        strength,
        steps,
        _objective(image, target, root, strength),
        None,
        steps == ITERATIONS,
    )


def _automatic(problem: Problem) -> float:
    share = problem.usual_deviation / problem.spread if problem.spread > 0 else 0.0
    return float(LEAST * np.hypot(1, RANGE * min(share, 1.0) / NOISE))


def _slope(image: Image, target: Image, root: Image, strength: float) -> Image:
    data = _blurred(root * np.sign(_blurred(image) - target))
    return np.asarray(data + bilateral(image, _WEIGHTS, np.float32(2 * strength)), np.float32)


def _objective(image: Image, target: Image, root: Image, strength: float) -> float:
    data = float(np.abs(root * (_blurred(image) - target)).sum(dtype=np.float64))
    return data + strength * float(bilateral_value(image, _WEIGHTS))


def _blurred(image: Image) -> Image:
    return np.asarray(cv2.filter2D(image, -1, PSF, borderType=cv2.BORDER_REFLECT), np.float32)


def _weights() -> Image:
    offset = np.abs(np.arange(-REACH, REACH + 1))
    weights = ALPHA ** (offset[:, None] + offset[None]).astype(np.float64)
    weights[REACH, REACH] = 0
    return weights.astype(np.float32)


_WEIGHTS = _weights()
