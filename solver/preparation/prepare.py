"""From registered frames to a method's problem."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.kernels import differences as kernels
from solver.options import SINGLE, FusionOptions
from solver.preparation import noise as noise_law
from solver.preparation.consensus import MAJORITY, Consensus
from solver.preparation.farthest import find_farthest, without
from solver.preparation.problem import Problem
from solver.preparation.scatter import LEAST, assign, scatter
from solver.preparation.wrapping import find_cut, unwrapped


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

    Dark samples are left out by the methods' own rule, samples without a position or too far always, and so
    are those that the other frames contradict, unless the noise is not known or the method shows one frame.

    Raises:
        FusionInputError: no sample is left.
    """
    lost = np.isnan(positions[..., 0])
    if lost.any():
        distance = np.where(lost, np.float32(np.nan), distance)
    farthest = find_farthest(distance, ambiguity_range)
    distance, beyond = without(distance, farthest)
    if noise is None:
        noise = noise_law.estimate(distance, amplitude, ambiguity_range)
    threshold = _threshold(amplitude, noise, ambiguity_range, options)
    local = None
    if amplitude is None:
        sigma = np.full(distance.shape, noise, np.float32)
        enough = len(distance) >= LEAST and noise > 0
        if options.method == "area" and ambiguity_range is not None and enough:
            local = scatter(distance, positions, noise, ambiguity_range)
            assign(local, positions, noise, sigma)
    else:
        unlit, distance, sigma = distance, np.empty_like(distance), np.empty_like(distance)
        if not _light(unlit, amplitude, noise, threshold, sigma, distance):
            raise FusionInputError(
                f"every pixel's amplitude is under amplitude_threshold {threshold:g} (highest "
                f"{np.nanmax(amplitude):g}); lower the threshold or expose longer"
            )
    cut = 0.0 if ambiguity_range is None else find_cut(distance, sigma, ambiguity_range)
    distance = unwrapped(distance, cut, ambiguity_range)
    consensus = None
    # Where the noise is not known, nothing says how far is too far.
    if len(distance) >= MAJORITY and noise > 0 and options.method not in SINGLE:
        consensus = Consensus(distance, sigma, positions, ambiguity_range, options.method == "phasor")
        distance = consensus.kept()
        if np.isnan(distance).all():
            raise FusionInputError(
                f"the frames contradict each other by far more than the noise of {noise:g}; give it in the "
                "unit of the distances, or None to have it estimated"
            )
    return Problem(
        distance,
        amplitude,
        positions,
        sigma,
        noise,
        ambiguity_range,
        guide,
        options,
        threshold,
        cut,
        farthest,
        beyond,
        consensus,
        local,
    )


def exchange(
    problem: Problem,
    slot: int,
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    positions: NDArray[np.float32],
) -> bool:
    """Put a frame (H, W) that looks at positions (H, W, 2) in the place of frame `slot`.

    Noise, threshold and what else was learned of all frames stay. Frames of which the new one changes what
    agrees are exchanged as well. Returns whether the frame has a sample.
    """
    _count(problem, [slot], -1)
    problem.positions[slot] = positions
    lost = np.isnan(positions[..., 0])
    if lost.any():
        distance = np.where(lost, np.float32(np.nan), distance)
    (distance,), (problem.beyond[slot],) = without(distance[None], problem.farthest)
    if problem.amplitude is None or amplitude is None:
        problem.distance[slot] = distance
        if problem.scatter is not None:
            one = slice(slot, slot + 1)
            assign(problem.scatter, problem.positions[one], problem.noise, problem.sigma[one])
    else:
        problem.amplitude[slot] = amplitude
        lit, sigma = problem.distance[slot], problem.sigma[slot]
        _light(distance, amplitude, problem.noise, problem.threshold, sigma, lit)
    problem.distance[slot] = unwrapped(problem.distance[slot], problem.cut, problem.ambiguity_range)
    others: list[int] = []
    if problem.consensus is not None:
        problem.consensus.measured[slot] = problem.distance[slot]
        others = problem.consensus.exchange(slot, problem.distance)
        _count(problem, others, -1)
        for number in (slot, *others):
            problem.distance[number] = problem.consensus.kept(number)
    problem.exchanged, problem.changed = (slot, *others), False
    _count(problem, problem.exchanged, 1)
    return bool(np.isfinite(problem.distance[slot]).any())


def _count(problem: Problem, frames: Iterable[int], sign: int) -> None:
    for number in frames:
        problem.count(slice(number, number + 1), problem.precision, sign)


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
