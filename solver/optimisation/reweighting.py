"""Reweighted passes: the prior learns edges and slopes from the map of the pass before.

λ ‖∇X‖ is replaced by gain · λ · ρ ‖∇X − s‖ pixel by pixel, s the slope (see `solver.optimisation.slope`) and

    ρ = 1 / (1 + (‖∇X − s‖ / ε)²)

of the map of the pass before, averaged over the nearest pixels. Smooth parts are smoothed more, edges keep
their height; the slope keeps ramps from becoming stairs; and ties keep along edges what the weights give away
there (see `optimisation.ties`). Samples that the first map does not explain lose weight: deconvolution would
fit them by swings, and the weights would take these for edges. Where the first map swings even so, the
following passes are not weighted, and smooth more (see `optimisation.swings`). Source: Candès, Wakin, Boyd,
"Enhancing sparsity by reweighted ℓ1 minimization", J. Fourier Anal. Appl. 2008; the square and the average
are measured, and gain with ties only. Each pass is convex, the whole is not: objective, gap and stopping rule
are those of the last pass.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.kernels import learning as kernels
from solver.kernels.smoothing import gaussian
from solver.optimisation.memory_gradient import Memory, Outcome, minimise
from solver.optimisation.prior import Prior
from solver.optimisation.slope import slope
from solver.optimisation.swings import find_swings
from solver.optimisation.term import State, Term, start_at
from solver.optimisation.ties import Ties
from solver.options import FusionOptions
from solver.result import Progress
from solver.runtime import team

_AROUND = 0.7
"""Deviation of the Gaussian that averages ‖∇X − s‖, fused pixels."""

_TAPS = 3
"""To either side: 4 deviations."""

_RENEWED, _BLUNTER = 6, 8.0
"""The most iterations of a pass with weights, or of the only one, where a stream is prepared anew, and the
factor on the ε at which a pass, or the one before it, ended, for the start of the next: to the end, or from
the bluntest ε, it would take several times as many, for a map that is no better."""

_NEAR = 4.0
"""Factor on the tolerance of the last pass with weights: nearer to its minimum a map is no nearer to the
scene."""

_A_FEW, _PLAIN = 2, 4
"""The most iterations after an exchange of one frame, with weights and without: what is left, those after the
next ones do. Without weights, fewer fall behind the data. Where more frames changed, so did the scene, and
`_RENEWED` follow it."""


@dataclass(frozen=True, slots=True)
class Reweighting:
    """How often, how strongly, and at which gradient.

    Attributes:
        tied: makes the data term with ties.
        distrust: weighs down samples that a padded map does not explain, but for those in its swings.
        passes: passes after the first one, which is not weighted.
        gain: factor on λ where the map is flat.
        epsilon: ‖∇X − s‖ at which ρ is a half, in units of λ.
        edge: ‖∇X‖ from which a pixel has no say in the slope, in units of λ.
        tie, across: strength and δ of the ties, see `solver.optimisation.ties`, in units of λ.
        tolerance: of all passes but the last, which only have to find the edges.
        smoother: factor on λ where the first map swings; None = swings are not looked for.
        outvoted: part of the map up to which samples in swings are distrusted too: most around are right.
    """

    tied: Callable[[Ties], Term]
    distrust: Callable[[NDArray[np.floating], NDArray[np.floating] | None], None]
    passes: int
    gain: float
    epsilon: float
    edge: float
    tie: float
    across: float
    tolerance: float = 1e-2
    smoother: float | None = None
    outvoted: float = 0.0


@dataclass(frozen=True, slots=True)
class Unit:
    """A map in the caller's unit is `scale` · x + `offset`, x being in units of λ."""

    scale: float
    offset: float = 0.0


@dataclass(slots=True)
class Trail:
    """Where the passes of a run ended, from which the next run on about the same data starts.

    Attributes:
        unit: of the states.
        plan: of the passes.
        states, terms: by pass.
        memory: of the last pass, for the arrays that it has.
        followed: whether the last pass has gone on since, with frames exchanged.
    """

    unit: Unit
    plan: Reweighting | None
    states: list[State]
    terms: list[Term]
    memory: Memory | None = None
    followed: bool = False

    def start(self, number: int, unit: Unit) -> State:
        """The end of a pass as a start without weights, in another unit.

        The last pass starts blunter than it ended: with ε as sharp a map follows new data so slowly that it
        seems to have settled. A first one that others follow goes on as it was; those with weights start
        anew, for these are new, but for a last one that has followed the data, which is not run to its end.
        """
        state, kind = self.states[number], self.states[number].x.dtype.type
        x = state.x * kind(self.unit.scale / unit.scale)
        x += kind((self.unit.offset - unit.offset) / unit.scale)
        blunter = 1.0 if number == 0 else 0.0
        if number + 1 == len(self.states) and (number == 0 or self.followed):
            blunter = _BLUNTER
        return replace(start_at(x), epsilon=blunter * state.epsilon)


def minimise_reweighted(
    term: Term,
    prior: Prior,
    first: Callable[[], State],
    plan: Reweighting | None,
    *,
    unit: Unit,
    options: FusionOptions,
    trail: Trail | None,
    progress: Progress | None,
) -> tuple[Outcome, Trail]:
    """Run all passes; `max_iterations` bounds them together, one iteration each at least.

    Without a plan there is one pass, not weighted. It starts from the state `first()`, in units of λ, or
    from the `trail` of a run before, whose outcome is not certified: its gap is NaN. Where that one's last
    pass has gone on since, those with weights, or the only one, are not run to their end.
    """
    state, swings = first() if trail is None else trail.start(0, unit), None
    ends, done = Trail(unit, plan, [state], [term]), 0
    passes, early, late = (0, 0.0, 1.0) if plan is None else (plan.passes, plan.tolerance, _NEAR)
    enough = _RENEWED if trail is not None and trail.followed else options.max_iterations
    for number in range(passes + 1):
        last = number == passes
        most = enough if last or number > 0 else options.max_iterations
        outcome = minimise(
            ends.terms[number],
            prior,
            ends.states[number],
            tolerance=late * options.tolerance if last else max(options.tolerance, early),
            limit=max(1, min(options.max_iterations - done, most)),
            scale=unit.scale**2,
            progress=progress,
            certify=last and trail is None,
        )
        done += outcome.iterations
        if plan is not None and not last:
            before = ends.states[number]
            if number == 0:
                swings = None if plan.smoother is None else find_swings(prior.norms(before.x), plan.epsilon)
                many = swings is not None and swings.mean() > plan.outvoted
                plan.distrust(before.x, swings if many else None)
            state = _following(before) if trail is None else trail.start(number + 1, unit)
            ends.states.append(state)
            ends.terms.append(_learn(prior, before, plan, state, swings))
    ends.memory = outcome.memory
    return replace(outcome, iterations=done), ends


def resume(trail: Trail, prior: Prior, options: FusionOptions, exchanged: int) -> Outcome:
    """Go on with the last pass alone, on data of which so many frames were exchanged; its gap is NaN.

    The state's `fit` is that to these data, or None.

    The weights stay: what a frame adds to them is not seen. New samples are not distrusted, or a map would
    hold out against a changed scene.
    """
    state, few = trail.states[-1], _PLAIN if trail.plan is None else _A_FEW
    outcome = minimise(
        trail.terms[-1],
        prior,
        state,
        tolerance=options.tolerance,
        limit=min(options.max_iterations, few if exchanged == 1 else _RENEWED),
        certify=False,
        window=1,
        memory=trail.memory,
    )
    trail.memory, trail.followed = outcome.memory, True
    return outcome


def _following(before: State) -> State:
    """A pass's start where the one before it ended, without weights."""
    return replace(start_at(before.x.copy()), epsilon=_BLUNTER * before.epsilon)


def _learn(
    prior: Prior, state: State, plan: Reweighting, following: State, swings: NDArray[np.floating] | None
) -> Term:
    """Give the next pass's state its weights and slope, and the data term ties along the edges."""
    kind = state.x.dtype.type
    following.slope = slope(state.x, plan.edge)
    norms, freed = prior.norms(state.x, following.slope), np.zeros_like(state.radius)
    taps = gaussian(_AROUND, _TAPS).astype(state.x.dtype)
    team.share(kernels.keep, norms, taps, kind(1 / plan.epsilon), kind(plan.gain), following.radius, freed)
    if swings is not None and plan.smoother is not None:
        following.slope *= 1 - swings
        following.radius += swings * (kind(plan.smoother) - following.radius)
        freed *= 1 - swings
    ties = Ties.along_edges(state.x, following.slope, prior, freed, plan.tie, plan.across)
    return plan.tied(ties)
