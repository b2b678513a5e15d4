"""`lidarboost`: sparse samples, squared data term, multi-scale group prior, one convex solve.

    E(X) = Σ_k ‖T_k W_k (D_k − X)‖² + λ Σ ‖∇X‖₂

Source: Schuon, Theobalt, Davis, Thrun, "LidarBoost: Depth Superresolution for ToF 3D Shape Scanning",
CVPR 2009. The whole image is solved at once; W_k is sparse (one fused pixel under each pixel's centre).
"""

import numpy as np
from numpy.typing import NDArray

from solver import kernels
from solver.fill import nearest
from solver.primal_dual import Iteration
from solver.prior import Prior
from solver.problem import Problem, Solution
from solver.result import Progress
from solver.sampling import Samples, sample

_AUTO = 0.04
"""λ in units of the data's range: the paper's, for depth scaled to [0, 1]."""


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Minimise E; pixels without samples are inpainted by the prior."""
    samples = sample(problem.distance, problem.positions, problem.options.upsampling)
    strength = _strength(problem, samples)
    seen = samples.weight > 0
    low, high = float(samples.mean[seen].min()), float(samples.mean[seen].max())
    # In units of λ about the middle of the data, so that float32 serves any unit and λ is 1.
    middle = 0.5 * (low + high)
    mean = np.where(seen, (samples.mean - middle) / strength, 0).astype(np.float32)
    start = nearest(mean, seen)
    if initial is not None:
        known = np.isfinite(initial.distance)
        start = np.where(known, (initial.distance - middle) / strength, start).astype(np.float32)
    low, high = (low - middle) / strength, (high - middle) / strength
    constant = samples.constant / strength**2
    prior = Prior()
    tau = sigma = np.float32(1 / prior.norm)
    shrink = np.asarray(1 / (1 + 2 * tau * samples.weight), np.float32)
    pull = np.asarray(2 * tau * samples.weight * mean * shrink, np.float32)
    x, over = start, start.copy()
    dual = np.zeros((len(prior.offsets), *x.shape), np.float32)

    def advance(count: int) -> None:
        kernels.iterate(count, x, over, dual, shrink, pull, prior.offsets, prior.weights, tau, sigma)

    def objective() -> float:
        data, total = kernels.energies(x, samples.weight, mean, prior.offsets, prior.weights)
        return (data + total + constant) * strength**2

    def bound() -> float:
        least = kernels.conjugate(dual, samples.weight, mean, low, high, prior.offsets, prior.weights)
        return (least + constant) * strength**2

    options = problem.options
    iterations, value, gap, converged = Iteration(
        advance, objective, bound, options.tolerance, options.max_iterations, progress
    ).run()
    fused = _restore(x, strength, middle)
    return Solution(fused, None, strength, iterations, value, gap, converged)


def _restore(x: NDArray[np.float32], strength: float, middle: float) -> NDArray[np.float32]:
    return (x * np.float32(strength) + np.float32(middle)).astype(np.float32)


def _strength(problem: Problem, samples: Samples) -> float:
    if problem.options.regularization != "auto":
        return float(problem.options.regularization)
    values = samples.mean[samples.weight > 0]
    spread = float(np.ptp(values))
    scale = max(float(np.abs(values).max()), float(np.finfo(np.float32).tiny))
    # A constant image has no spread; any λ gives it back.
    return max(_AUTO * spread, 1e-6 * scale)
