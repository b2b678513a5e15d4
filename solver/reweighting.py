"""Reweighted passes: the prior learns edges and slopes from the map of the pass before.

λ ‖∇X‖ is replaced by gain · λ ‖∇X − s‖ / (1 + ‖∇X − s‖ / ε) pixel by pixel, s the slope (see `solver.slope`).
The weight approaches a sum of log(1 + ‖∇X − s‖ / ε): smooth parts are smoothed more, edges keep their height;
the slope keeps ramps from becoming stairs. Source: Candès, Wakin, Boyd, "Enhancing sparsity by
reweighted ℓ1 minimization", J. Fourier Anal. Appl. 2008. Each pass is convex, the whole is not: objective,
gap and stopping rule are those of the last pass.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.memory_gradient import Outcome, State, Term, minimise, start
from solver.options import FusionOptions
from solver.prior import Prior, level
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
    first: Callable[[], NDArray[np.floating]],
    plan: Reweighting,
    *,
    unit: Unit,
    options: FusionOptions,
    trail: Trail | None,
    progress: Progress | None,
) -> tuple[Outcome, Trail]:
    """Run all passes; `max_iterations` bounds them together, one iteration each at least.

    It starts from the map `first()`, (C, rows, columns) in units of λ, or from the `trail` of a run before,
    whose outcome is not certified: its gap is NaN.
    """
    state = start(first()) if trail is None else _resumed(trail, 0, unit)
    done, ends = 0, []
    for turn in range(plan.passes + 1):
        last = turn == plan.passes
        if turn and trail is not None:
            state = replace(_resumed(trail, turn, unit), radius=state.radius, slope=state.slope)
        outcome = minimise(
            term,
            prior,
            state,
            tolerance=options.tolerance if last else max(options.tolerance, plan.tolerance),
            limit=max(1, options.max_iterations - done),
            scale=unit.scale**2,
            progress=progress,
            certify=last and trail is None,
        )
        done += outcome.iterations
        ends.append((unit.outward(state.x), state.epsilon))
        if not last:
            state.slope = slope(state.x, plan.edge)
            norms = prior.norms(state.x, state.slope)
            norms *= norms.dtype.type(1 / plan.epsilon)
            norms += 1
            np.divide(plan.gain, norms, out=state.radius)
            state.epsilon = 0.0
    maps, epsilons = zip(*ends, strict=True)
    return replace(outcome, iterations=done), Trail(maps, epsilons)


def _resumed(trail: Trail, turn: int, unit: Unit) -> State:
    x = unit.inward(trail.maps[turn])
    return State(x, np.ones_like(x[0]), level(x), trail.epsilons[turn])
