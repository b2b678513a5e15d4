"""`area`: every sample is the average over its pixel's footprint at its exact sub-pixel position.

    E(X) = Σ_k ‖Ω_k^½ (y_k − A_k X)‖² + λ Σ ‖∇X‖₂

y are distances, those at edges as they would be if a pixel averaged distances where it averages phasors (see
`solver.preparation.unmixing`). Ω weighs samples by their deviations, the median's over their own, so that λ
stays in units of distance, and what is n times as noisy is smoothed as by a λ n times as large. E is solved
once; two more passes know its edges and slopes (see `solver.optimisation.reweighting`).
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.optimisation.footprint import AreaTerm
from solver.optimisation.memory_gradient import Outcome
from solver.optimisation.padding import cropped
from solver.optimisation.prior import Prior
from solver.optimisation.reweighting import Reweighting, Trail, Unit, minimise_reweighted, resume
from solver.optimisation.term import start
from solver.optimisation.ties import Tied
from solver.preparation import noise as noise_law
from solver.preparation.consensus import LOST
from solver.preparation.problem import Problem, Solution
from solver.result import Progress

_NOISE, _FRAMES, _FACTOR, _WIDE = 1.8, 15, 4, 100.0
"""λ = 1.8 n (n / R)^¼ √(N / 15) √(4 / β), n = √(σ² + mixing²), R the ambiguity range, or a hundred times the
scene's where there is none. The noise in a sum over the N / β² samples of a fused pixel asks for √N / β, fine
relief for no β. The power of n is set by trial; it lies between the 1 of a discrepancy rule and the 2 of a
Laplacian prior. What the scene is like does not enter: over the tuning scenes λ follows neither the height of
their steps nor how many there are."""

_MIXING_LIT, _MIXING = 0.006, 0.012
"""Of the scene's range: what a sample errs by without noise, as it is mixed at edges, where the lights are
known or samples average distances, and where neither is."""

_PASSES, _GAIN, _EPSILON, _EDGE = 2, 2.5, 0.12, 0.025
"""Reweighting; ε and edge in units of the scene's range. One weighted pass is worse, a third no better."""

_TIE, _ACROSS = 0.1, 0.055
"""Ties: the ‖∇X − s‖ at which the prior is as stiff, and δ, in units of the scene's range. Both
are set by trial."""

_DOUBT, _ERRING = 10.0, 0.025
"""Deviations of a usual sample, and √n as many of one that is n times as noisy, and part of the scene's
range, that a sample may differ from the first map. From 5 to 14 deviations hardly matter."""

_SETTLED = 0.02
"""Tolerance of the passes before the last, which need no more than to find the edges."""

_SMOOTHER = 10.0
"""Factor on λ where the first map swings: far less or more takes longer there."""

_OUTVOTED = 0.08
"""Of the map: with more swings, and of two frames, what the map leaves over tells wrong samples by chance.
A mirrored frame among ten makes half as many, and is to be distrusted."""

_LEAST = 0.5
"""Of the usual deviation, the least that counts: it is mixing at edges, not noise, that brighter samples are
wrong by."""


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Minimise E; what no footprint covers is inpainted by the prior."""
    trail = None if initial is None or problem.changed else initial.trail
    if problem.exchanged and trail is not None:
        outcome = _resume(problem, trail)
    else:
        outcome, trail = _run(problem, trail, progress)
    strength, middle = trail.unit.scale, trail.unit.offset
    distance = cropped(outcome.state.x, problem.fused_shape)[0] * np.float32(strength) + np.float32(middle)
    if problem.consensus is not None:
        deviation = problem.usual_deviation if problem.noise else 0.0
        problem.consensus.limit(distance, deviation, mixed=problem.ambiguity_range is not None)
    return Solution(
        distance,
        None,
        strength,
        outcome.iterations,
        outcome.objective * strength**2,
        outcome.gap,
        outcome.converged,
        relative=strength / problem.usual_deviation,
        trail=trail,
    )


def _run(problem: Problem, trail: Trail | None, progress: Progress | None) -> tuple[Outcome, Trail]:
    used = np.isfinite(problem.distance)
    strength = _strength(problem, used)
    unit = Unit(strength, 0.5 * (float(problem.distance[used].min()) + float(problem.distance[used].max())))
    options = problem.options
    values, weights = _samples(problem, unit, slice(None))
    term = AreaTerm(values, weights, problem.positions, options.upsampling, options.footprint)
    return minimise_reweighted(
        term,
        Prior(options.neighbourhood),
        lambda: start(term.mean()),
        _plan(problem, term, strength),
        unit=unit,
        options=options,
        trail=trail,
        progress=progress,
    )


def _resume(problem: Problem, trail: Trail) -> Outcome:
    term = trail.terms[0]
    assert isinstance(term, AreaTerm)
    samples = partial(_samples, problem, trail.unit)
    term.follow(trail.states[-1], problem.exchanged, samples, problem.positions)
    return resume(trail, Prior(problem.options.neighbourhood), problem.options, len(problem.exchanged))


def _samples(problem: Problem, unit: Unit, frames: slice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Values (1, n, H, W) in units of λ and weights (n, H, W) of n frames."""
    distance, sigma = problem.distance[frames], problem.sigma[frames]
    least = np.float32(_LEAST * problem.usual_deviation)
    if problem.unmixing is None:
        deviation = np.maximum(sigma, least)
    else:
        distance, deviation = problem.unmixing.means(distance, sigma, problem.positions[frames], least)
    used = np.isfinite(distance)
    scaled = (distance - np.float32(unit.offset)) * np.float32(1 / unit.scale)
    return np.where(used, scaled, np.float32(0))[None], _weights(problem, used, sigma, deviation)


def _plan(problem: Problem, term: AreaTerm, strength: float) -> Reweighting:
    """The passes; the scene's range and the usual sample's deviation are in units of λ."""
    extent = max(problem.spread, strength) / strength
    noise = problem.usual_deviation / strength
    return Reweighting(
        tied=partial(Tied, term),
        distrust=partial(term.distrust, noise=_DOUBT * noise, slack=_ERRING * extent),
        passes=_PASSES,
        gain=_GAIN,
        epsilon=_EPSILON * extent,
        edge=_EDGE * extent,
        tie=_GAIN / (_TIE * extent),
        across=_ACROSS * extent,
        tolerance=_SETTLED,
        smoother=_SMOOTHER,
        outvoted=0.0 if problem.consensus is None else _OUTVOTED,
    )


def _strength(problem: Problem, used: NDArray[np.bool_]) -> float:
    if problem.options.regularization != "auto":
        return float(problem.options.regularization)
    scale = max(float(np.abs(problem.distance[used]).max()), float(np.finfo(np.float32).tiny))
    extent = max(noise_law.spread(problem.sure()), 1e-6 * scale)
    told = problem.amplitude is not None or problem.ambiguity_range is None
    noise = float(np.hypot(problem.usual_deviation, (_MIXING_LIT if told else _MIXING) * extent))
    share = (noise / (problem.ambiguity_range or _WIDE * extent)) ** 0.25
    samples = (len(problem.distance) / _FRAMES) * (_FACTOR / problem.options.upsampling)
    return float(_NOISE * noise * share * np.sqrt(samples))


def _weights(
    problem: Problem, used: NDArray[np.bool_], sigma: NDArray[np.float32], deviation: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Weights of used samples, by their `deviation`; which are lost is told by their own, `sigma`."""
    usual = problem.usual_deviation
    if not problem.noise or not _any_within(problem, used & np.isfinite(sigma), np.inf):
        return used.astype(np.float32)
    if problem.ambiguity_range is not None:
        kept = used & (sigma <= problem.ambiguity_range / LOST)
        used = kept if _any_within(problem, kept, problem.ambiguity_range / LOST) else used
    return np.where(used, np.float32(usual) / deviation, np.float32(0))


def _any_within(problem: Problem, kept: NDArray[np.bool_], most: float) -> bool:
    """Whether any is kept of some frames, or else any sample of all frames deviates by at most this much."""
    if kept.any():
        return True
    limit = min(most, float(np.finfo(np.float32).max))
    return bool((np.isfinite(problem.distance) & (problem.sigma <= limit)).any())
