"""From registered frames to a method's problem, and from its solution to the finished map."""

import numpy as np
from numpy.typing import NDArray

from solver import noise as noise_law
from solver.deviation import deviation
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
    threshold = _threshold(amplitude, noise, ambiguity_range, options)
    if amplitude is None:
        sigma = np.full(distance.shape, noise, np.float32)
    else:
        unlit, distance, sigma = distance, np.empty_like(distance), np.empty_like(distance)
        if not _light(unlit, amplitude, noise, threshold, sigma, distance):
            raise FusionInputError(
                f"every pixel's amplitude is under amplitude_threshold {threshold:g} (highest "
                f"{np.nanmax(amplitude):g}); lower the threshold or expose longer"
            )
    return Problem(distance, amplitude, positions, sigma, noise, ambiguity_range, guide, options, threshold)


def exchange(
    problem: Problem,
    slot: int,
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    positions: NDArray[np.float32],
) -> bool:
    """Put a frame (H, W) that looks at positions (H, W, 2) in the place of frame `slot`.

    Noise, threshold and what else was learned of all frames stay. Returns whether the frame has a sample.
    """
    problem.count(slice(slot, slot + 1), problem.precision, -1)
    problem.exchanged, problem.positions[slot] = slot, positions
    lost = np.isnan(positions[..., 0])
    if lost.any():
        distance = np.where(lost, np.float32(np.nan), distance)
    if problem.amplitude is None or amplitude is None:
        problem.distance[slot] = distance
        count = int(np.isfinite(distance).sum())
    else:
        problem.amplitude[slot] = amplitude
        kept, sigma = problem.distance[slot], problem.sigma[slot]
        count = _light(distance, amplitude, problem.noise, problem.threshold, sigma, kept)
    problem.count(slice(slot, slot + 1), problem.precision, 1)
    return count > 0


def complete(problem: Problem, solution: Solution) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(distance, deviation), filled up to `fill` low-resolution pixels from the nearest used sample."""
    away = reach(problem.precision > 0)
    known = np.isfinite(solution.distance)
    if known.all():
        distance = solution.distance.copy()
    else:
        distance, beyond = smooth(solution.distance, known)
        np.maximum(away, beyond, out=away)
    return distance, deviation(problem, solution, away, distance)


def _threshold(
    amplitude: NDArray[np.float32] | None, noise: float, ambiguity_range: float | None, options: FusionOptions
) -> float:
    """That of T_k in the paper. `phasor` and `area` weigh samples by themselves."""
    if options.amplitude_threshold != "auto":
        return float(options.amplitude_threshold)
    if amplitude is None or options.method in ("phasor", "area"):
        return 0.0
    return noise_law.amplitude_threshold(amplitude, noise, ambiguity_range)


def _light(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32],
    noise: float,
    threshold: float,
    sigma: NDArray[np.float32],
    kept: NDArray[np.float32],
) -> int:
    """kept ← T_k of the paper: NaN where the amplitude is under the threshold; the number of samples left.

    sigma ← one standard deviation of each sample, infinite at amplitude 0.
    """
    flat = (image.reshape(-1) for image in (sigma, kept))
    law = np.float32(noise), np.float32(threshold)
    return int(kernels.light(distance.ravel(), amplitude.ravel(), *law, *flat))
