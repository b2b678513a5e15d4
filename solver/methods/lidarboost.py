"""`lidarboost`: sparse samples, squared data term, multi-scale group prior, one convex solve.

    E(X) = Σ_k ‖T_k W_k (D_k − X)‖² + λ Σ ‖∇X‖₂

Source: Schuon, Theobalt, Davis, Thrun, "LidarBoost: Depth Superresolution for ToF 3D Shape Scanning",
CVPR 2009. The whole image is solved at once; W_k is sparse (one fused pixel under each pixel's centre). T_k
leaves out what is too dark; of the rest, a sample n times as noisy as the usual one counts an n-th: so all
pull with the same noise, and one λ suits what is lit and what is dim. Without amplitude all count alike.
"""

import numpy as np
from numpy.typing import NDArray

from solver.optimisation.padding import cropped
from solver.optimisation.prior import Prior
from solver.optimisation.pyramid import coarse_start
from solver.optimisation.reweighting import Unit, minimise_reweighted, resume
from solver.optimisation.sampling import SparseTerm, sample
from solver.preparation.problem import Problem, Solution
from solver.result import Progress

_NOISE, _MIXING = 1.4, 0.006
"""λ in units of the noise in a sum over the samples of a fused pixel, √n times the usual deviation, and of
the scene's range: noise-free samples still disagree, by what their footprints mix at edges. Both optima are
flat, for 4 to 60 frames, β from 2 to 8, and from a sixteenth to four times the noise."""


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Minimise E; pixels without samples are inpainted by the prior."""
    samples = sample(problem.distance, _weights(problem), problem.positions, problem.options.upsampling)
    trail = None if initial is None or problem.changed else initial.trail
    going_on = trail if problem.exchanged else None
    # In units of λ about the middle of the data, so that float32 serves any unit and λ is 1.
    middle = 0.5 * (samples.low + samples.high)
    unit = going_on.unit if going_on is not None else Unit(_strength(problem), middle)
    strength, middle = unit.scale, unit.offset
    mean = samples.mean
    mean -= np.float32(middle)
    mean *= np.float32(1 / strength)
    term = SparseTerm(samples.weight, mean, samples.constant / strength**2)
    prior = Prior(problem.options.neighbourhood)
    if going_on is not None:
        going_on.terms, going_on.states[-1].fit = [term], None
        outcome = resume(going_on, prior, problem.options, len(problem.exchanged))
    else:
        outcome, trail = minimise_reweighted(
            term,
            prior,
            lambda: coarse_start(
                mean, samples.weight, problem.options.upsampling, prior, problem.options.tolerance
            ),
            None,
            unit=unit,
            options=problem.options,
            trail=trail,
            progress=progress,
        )
    fused = cropped(outcome.state.x, problem.fused_shape)[0] * np.float32(strength) + np.float32(middle)
    return Solution(
        fused,
        None,
        strength,
        outcome.iterations,
        outcome.objective * strength**2,
        outcome.gap,
        outcome.converged,
        relative=strength / (problem.usual_deviation * _sums(problem, len(problem.distance))),
        trail=trail,
    )


def _weights(problem: Problem) -> NDArray[np.float32]:
    """(N, H, W), 1 or less; 0 = not used. Samples that all lack light count alike."""
    used, usual = np.isfinite(problem.distance), np.float32(problem.usual_deviation)
    weights = np.where(used, usual / np.maximum(problem.sigma, usual), np.float32(0))
    return weights if weights.any() else used.astype(np.float32)


def _strength(problem: Problem) -> float:
    if problem.options.regularization != "auto":
        return float(problem.options.regularization)
    scale = max(float(np.nanmax(np.abs(problem.distance))), float(np.finfo(np.float32).tiny))
    used = np.isfinite(problem.distance).astype(np.float32)
    counts = sample(problem.distance, used, problem.positions, 1).weight
    noise = problem.usual_deviation * _sums(problem, float(np.median(counts[counts > 0])))
    # A constant image has neither noise nor range; any λ gives it back.
    return max(float(np.hypot(_NOISE * noise, _MIXING * problem.spread)), 1e-6 * scale)


def _sums(problem: Problem, count: float) -> float:
    """√n, with so many samples on a low-resolution pixel: the noise of their sum on a fused one."""
    return float(np.sqrt(count)) / problem.options.upsampling
