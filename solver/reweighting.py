"""Reweighted passes: the prior learns edges and slopes from the map of the pass before.

λ ‖∇X‖ is replaced by gain · λ ‖∇X − s‖ / (1 + ‖∇X − s‖ / ε) pixel by pixel, s the slope (see `solver.slope`).
The weight approaches a sum of log(1 + ‖∇X − s‖ / ε): smooth parts are smoothed more, edges keep their height;
the slope keeps ramps from becoming stairs. Source: Candès, Wakin, Boyd, "Enhancing sparsity by
reweighted ℓ1 minimization", J. Fourier Anal. Appl. 2008. Each pass is convex, the whole is not: objective,
gap and stopping rule are those of the last pass.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.memory_gradient import Outcome, State, Term, minimise
from solver.options import FusionOptions
from solver.prior import Prior
from solver.result import Progress
from solver.slope import slope


@dataclass(frozen=True, slots=True)
class Reweighting:
    """How often, how strongly, and at which gradient.

    Attributes:
        passes: passes after the first one, which is not weighted.
        gain: factor on λ where the map is flat.
        epsilon: ‖∇X − s‖ at which λ is halved, in units of λ.
        edge: ‖∇X‖ from which a pixel has no say in the slope, in units of λ.
        tolerance: of all passes but the last, which only have to find the edges.
    """

    passes: int = 0
    gain: float = 1.0
    epsilon: float = 1.0
    edge: float = 1.0
    tolerance: float = 1e-2


@dataclass(frozen=True, slots=True)
class Trail:
    """Where the passes of a run ended, from which those of the next one on about the same data start.

    Attributes:
        maps: by pass, (C, rows + 4, columns + 4) in the caller's unit.
        epsilons: by pass, see `State`.
    """

    maps: tuple[NDArray[np.floating], ...]
    epsilons: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Unit:
    """A map in the caller's unit is `scale` · x + `offset`, x being in units of λ."""

    scale: float
    offset: float = 0.0

    def outward(self, x: NDArray[np.floating]) -> NDArray[np.floating]:
        """From units of λ."""
        return np.asarray(x * x.dtype.type(self.scale) + x.dtype.type(self.offset))

    def inward(self, image: NDArray[np.floating]) -> NDArray[np.floating]:
        """To units of λ."""
        kind = image.dtype.type
        return np.asarray((image - kind(self.offset)) * kind(1 / self.scale))


def minimise_reweighted(
    term: Term,
    prior: Prior,
    state: State,
    plan: Reweighting,
    *,
    unit: Unit,
    options: FusionOptions,
    trail: Trail | None,
    progress: Progress | None,
) -> tuple[Outcome, Trail]:
    """Run all passes from the state; `max_iterations` bounds them together, one iteration each at least."""
    done = 0
    maps, epsilons = [], []
    usable = trail is not None and trail.maps[-1].shape == state.x.shape
    for turn in range(plan.passes + 1):
        last = turn == plan.passes
        state.epsilon = 0.0
        if trail is not None and usable:
            state.x, state.epsilon, state.fit = unit.inward(trail.maps[turn]), trail.epsilons[turn], None
        outcome = minimise(
            term,
            prior,
            state,
            tolerance=options.tolerance if last else max(options.tolerance, plan.tolerance),
            limit=max(1, options.max_iterations - done),
            scale=unit.scale**2,
            progress=progress,
            certify=last,
        )
        done += outcome.iterations
        maps.append(unit.outward(state.x))
        epsilons.append(state.epsilon)
        if not last:
            state.slope = slope(state.x, plan.edge)
            state.radius[...] = plan.gain / (1 + prior.norms(state.x, state.slope) / plan.epsilon)
    return replace(outcome, iterations=done), Trail(tuple(maps), tuple(epsilons))
