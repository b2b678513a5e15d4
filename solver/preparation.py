"""From registered frames to a method's problem, and from its solution to the finished map."""

import numpy as np
from numpy.typing import NDArray

from solver import noise as noise_law
from solver.deviation import deviation, sample_precision
from solver.errors import FusionInputError
from solver.fill import reach, smooth
from solver.kernels import noise as kernels
from solver.options import FusionOptions
from solver.problem import Problem, Solution


def prepare(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    positions: NDArray[np.float32],
    *,
    options: FusionOptions,
    ambiguity_range: float | None = None,
    noise: float | None = None,
    guide: NDArray[np.float32] | None = None,
) -> Problem:
    """The problem of fusing (N, H, W) frames that look at positions (N, H, W, 2).

    Dark samples are left out by the methods' own rule, samples without a position always.

    Raises:
        FusionInputError: no sample is left.
    """
    lost = np.isnan(positions[..., 0])
    if lost.any():
        distance = np.where(lost, np.float32(np.nan), distance)
    if noise is None:
        noise = noise_law.estimate(distance, amplitude, ambiguity_range)
    if amplitude is None:
        sigma = np.full(distance.shape, noise, np.float32)
    else:
        distance, sigma = _lit(distance, amplitude, noise, ambiguity_range, options)
    return Problem(distance, amplitude, positions, sigma, noise, ambiguity_range, guide, options)


def complete(problem: Problem, solution: Solution) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(distance, deviation), filled up to `fill` low-resolution pixels from the nearest used sample."""
    precision = sample_precision(problem)
    away = reach(precision > 0)
    known = np.isfinite(solution.distance)
    if known.all():
        distance = solution.distance.copy()
    else:
        distance, beyond = smooth(solution.distance, known)
        np.maximum(away, beyond, out=away)
    return distance, deviation(problem, solution, precision, away, distance)


def _lit(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32],
    noise: float,
    ambiguity_range: float | None,
    options: FusionOptions,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """T_k of the paper: NaN where the amplitude is under the threshold. `phasor` weighs samples by itself.

    Also one standard deviation of each sample, infinite at amplitude 0.
    """
    threshold = options.amplitude_threshold
    if threshold == "auto":
        if options.method in ("phasor", "area"):
            threshold = 0.0
        else:
            threshold = noise_law.amplitude_threshold(amplitude, noise, ambiguity_range)
    kept, sigma = np.empty_like(distance), np.empty_like(distance)
    flat = distance.ravel(), amplitude.ravel()
    if not kernels.light(*flat, np.float32(noise), np.float32(threshold), sigma.ravel(), kept.ravel()):
        raise FusionInputError(
            f"every pixel's amplitude is under amplitude_threshold {threshold:g} (highest "
            f"{np.nanmax(amplitude):g}); lower the threshold or expose longer"
        )
    return kept, sigma
