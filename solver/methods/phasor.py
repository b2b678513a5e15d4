"""`phasor`: fuse what a pixel really measures, a complex number, instead of its angle.

    E(Z) = Σ_k ‖y_k − A_k Z‖² + λ Σ ‖∇Z‖₂,   y = amplitude · exp(2πi · distance / ambiguity range)

Z is complex, one group norm over real and imaginary parts and all offsets; distance = angle(Z),
amplitude = |Z|. A pixel at a depth edge averages the two phasors, not the two distances, and the noise is
nearly uniform in the complex plane, so dark samples need no weights. A second pass knows edges and slopes
(see `solver.reweighting`); at the end each fused pixel is given to one surface (see `solver.unmixing`).
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.footprint import AreaTerm
from solver.kernels import phasor as phasors
from solver.kernels import team
from solver.padding import cropped
from solver.plausibility import around
from solver.prior import Prior
from solver.problem import Problem, Solution
from solver.result import Progress
from solver.reweighting import Reweighting, Unit, minimise_reweighted, resume
from solver.ties import Tied
from solver.unmixing import unmix

_AUTO = 0.8
"""λ in units of one sample's deviation, both in units of the median amplitude."""

_LEAST = 1e-3
"""λ of noise-free frames, in units of the median amplitude."""

_PASSES, _GAIN, _EPSILON, _EDGE = 1, 2.5, 0.22, 0.07
"""Reweighting; ε and edge in units of the median amplitude. A second weighted pass costs 5 % of the RMS."""

_TIE, _ACROSS = 0.15, 0.1
"""Ties: the ‖∇Z − s‖ at which the prior is as stiff, and δ, in median amplitudes."""

_DOUBT, _ERRING = 5.0, 0.1
"""Deviations and median amplitudes that a sample may differ from the first map."""

_LOST = 4.0
"""|Z| under this many deviations of one sample has lost its angle."""


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Minimise E.

    Distances are given from 0 up to the ambiguity range, NaN where |Z| is lost in its noise.
    """
    if problem.amplitude is None or problem.ambiguity_range is None:
        raise FusionInputError("phasor needs amplitude and ambiguity_range")
    usual = problem.usual_light
    if not usual:
        raise FusionInputError("amplitude is 0 wherever there is a distance; phasor needs received light")
    turn = 2 * np.pi / problem.ambiguity_range
    sigma = turn * problem.noise / usual
    asked = problem.options.regularization
    strength = max(_AUTO * sigma, _LEAST) if asked == "auto" else float(asked)
    factor, prior = problem.options.upsampling, Prior(problem.options.neighbourhood)
    trail = None if initial is None else initial.trail
    if problem.exchanged and trail is not None and isinstance(trail.terms[0], AreaTerm):
        exchanged = partial(_samples, problem, trail.unit.scale)
        trail.terms[0].follow(trail.states[-1], problem.exchanged, exchanged, problem.positions)
        outcome = resume(trail, prior, problem.options, len(problem.exchanged))
    else:
        samples = _samples(problem, strength * usual, slice(None))
        term = AreaTerm(*samples, problem.positions, factor, problem.options.footprint)
        outcome, trail = minimise_reweighted(
            term,
            prior,
            term.mean,
            _plan(term, strength, sigma),
            unit=Unit(strength * usual),
            options=problem.options,
            trail=trail,
            progress=progress,
        )
    z = unmix(cropped(outcome.state.x, problem.fused_shape) * np.float32(strength))
    distance, amplitude = z
    low, high = around(problem, problem.noise / usual, problem.ambiguity_range)
    team.share(
        phasors.resolve,
        distance,
        amplitude,
        low,
        high,
        factor,
        np.float32(_LOST * sigma),
        np.float32(1 / turn),
        np.float32(usual),
    )
    return Solution(
        distance,
        amplitude,
        strength,
        outcome.iterations,
        outcome.objective * (strength * usual) ** 2,
        outcome.gap,
        outcome.converged,
        relative=strength / max(sigma, 1e-12),
        trail=trail,
    )


def _samples(problem: Problem, unit: float, frames: slice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Values (2, n, H, W) in the unit given and weights (n, H, W) of n frames."""
    assert problem.amplitude is not None
    assert problem.ambiguity_range is not None
    distance = problem.distance[frames]
    phase = distance * np.float32(2 * np.pi / problem.ambiguity_range)
    values = np.empty((2, *phase.shape), np.float32)
    np.cos(phase, out=values[0])
    np.sin(phase, out=values[1])
    values *= problem.amplitude[frames] * np.float32(1 / unit)
    return values, np.isfinite(distance).astype(np.float32)


def _plan(term: AreaTerm, strength: float, noise: float) -> Reweighting:
    return Reweighting(
        tied=partial(Tied, term),
        distrust=partial(term.distrust, noise=_DOUBT * noise / strength, slack=_ERRING / strength),
        passes=_PASSES,
        gain=_GAIN,
        epsilon=_EPSILON / strength,
        edge=_EDGE / strength,
        tie=_GAIN * strength / _TIE,
        across=_ACROSS / strength,
    )
