"""Reweighted passes: the prior learns edges and slopes from the map of the pass before.

λ ‖∇X‖ is replaced by gain · λ ‖∇X − s‖ / (1 + ‖∇X − s‖ / ε) pixel by pixel, s the slope (see `solver.slope`).
The weight approaches a sum of log(1 + ‖∇X − s‖ / ε): smooth parts are smoothed more, edges keep their height;
the slope keeps ramps from becoming stairs. Source: Candès, Wakin, Boyd, "Enhancing sparsity by
reweighted ℓ1 minimization", J. Fourier Anal. Appl. 2008. Each pass is convex, the whole is not: objective,
gap and stopping rule are those of the last pass.
"""

from dataclasses import dataclass, replace

from solver.primal_dual import Outcome, State, Term, minimise
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

    passes: int
    gain: float
    epsilon: float
    edge: float
    tolerance: float = 1e-2


def minimise_reweighted(
    term: Term,
    prior: Prior,
    state: State,
    plan: Reweighting,
    *,
    tolerance: float,
    limit: int,
    scale: float,
    progress: Progress | None,
) -> Outcome:
    """Run all passes from the state; `limit` bounds their iterations together, one each at least."""
    done = 0
    for turn in range(plan.passes + 1):
        last = turn == plan.passes
        outcome = minimise(
            term,
            prior,
            state,
            tolerance=tolerance if last else max(tolerance, plan.tolerance),
            limit=max(1, limit - done),
            scale=scale,
            progress=progress,
            certify=last,
        )
        done += outcome.iterations
        if not last:
            state.slope = slope(state.x, plan.edge)
            state.radius[...] = plan.gain / (1 + prior.norms(state.x, state.slope) / plan.epsilon)
    return replace(outcome, iterations=done)
