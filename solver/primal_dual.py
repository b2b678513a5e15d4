"""The iteration: a primal–dual algorithm with over-relaxation, its stopping rule and its certificate.

It minimises term(X) + Σ r ‖∇X − s‖₂ (maps are in units of λ; r = 1 and s = 0 but in reweighted passes),
the prior through its dual variables, the term through its proximal map or its gradient. Sources:
Chambolle, Pock, "A first-order primal-dual algorithm for convex problems with applications to imaging",
JMIV 2011, algorithm 1; Condat, "A primal-dual splitting method for convex optimization involving
Lipschitzian, proximable and linear composite terms", JOTA 2013, algorithm 3.1.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solver.kernels import prior as kernels
from solver.prior import Prior, level
from solver.result import Progress

_CHECK = 10
"""Iterations between two evaluations of the objective, which costs about as much as one iteration."""


@dataclass(slots=True)
class State:
    """A map in the middle of an iteration; arrays are padded by two pixels, (C, …, rows + 4, columns + 4)."""

    x: NDArray[np.floating]
    over: NDArray[np.floating]
    dual: NDArray[np.floating]
    radius: NDArray[np.floating]
    """λ by pixel, in units of λ: 1 everywhere unless the prior is weighted."""
    slope: NDArray[np.floating]
    """(C, 2, rows + 4, columns + 4), what `solver.slope` foretells, or (C, 2, 0, 0) = level."""


class Term(Protocol):
    """A convex data term, all in units of λ."""

    def steps(self, norm: float, variation: float) -> tuple[float, float, float]:
        """(τ, σ, ρ): the primal and the dual step and the over-relaxation.

        `norm` is the prior's; `variation` the mean ‖∇X‖ of the map at the start. The dual variables end up
        between 0 and 1 and the map near its start, so the larger its variation (the smaller λ), the longer
        the primal steps may be against the dual ones.
        """
        ...

    def pull(self, x: NDArray[np.floating], tau: float) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """(shrink, pull), padded: the step from x is (x − τ ∇ᵀ dual) · shrink + pull."""
        ...

    @property
    def fixed(self) -> bool:
        """Whether shrink and pull are the same for every x."""
        ...

    def value(self, x: NDArray[np.floating]) -> float:
        """The term at a padded map."""
        ...

    def bound(self, state: State, prior: Prior) -> float:
        """A lower bound of the least objective, good near the optimum; every group of dual is in its ball."""
        ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """The state reached, with iterations, objective, relative gap and whether the rule was met."""

    state: State
    iterations: int
    objective: float
    gap: float
    converged: bool


def start(initial: NDArray[np.floating]) -> State:
    """A state at the map (C, rows, columns)."""
    x = np.ascontiguousarray(np.pad(initial, [(0, 0), (kernels.PAD,) * 2, (kernels.PAD,) * 2]))
    return State(x, x.copy(), np.zeros((len(x), 6, *x.shape[1:]), x.dtype), np.ones_like(x[0]), level(x))


def warm(state: State, dual: NDArray[np.floating] | None) -> None:
    """Let the state go on from its map, with the dual variables of a solve of the same shape if any."""
    if dual is not None and dual.shape == state.dual.shape:
        state.dual[...] = dual
    state.over[...] = state.x


def minimise(
    term: Term,
    prior: Prior,
    state: State,
    *,
    tolerance: float,
    limit: int,
    scale: float = 1.0,
    progress: Progress | None = None,
    certify: bool = True,
) -> Outcome:
    """Run until the objective has settled.

    It stops where the error of the objective, estimated from its fall, is below `tolerance` of it; `scale`
    turns the objective into the caller's unit for `progress`. The gap is NaN unless `certify`.
    """
    roughness = prior.value(state.x, np.ones_like(state.radius), state.slope)
    pixels = (state.x.shape[1] - 2 * kernels.PAD) * (state.x.shape[2] - 2 * kernels.PAD)
    tau, sigma, rho = term.steps(prior.norm, roughness / pixels)
    kind = state.x.dtype.type
    up = kernels.tables(prior.weights.astype(kind), state.x.shape[2] - 4, sigma)
    down = prior.weights.astype(kind) * kind(tau)
    weighted = bool((state.radius != 1).any()) or state.slope.size > 0
    done, settled = 0, False
    history = [(0, term.value(state.x) + prior.value(state.x, state.radius, state.slope))]
    while done < limit and not settled:
        count = min(_CHECK, limit - done)
        for _ in range(1 if term.fixed else count):
            shrink, pull = term.pull(state.x, tau)
            kernels.iterate(
                count if term.fixed else 1,
                state.x,
                state.over,
                state.dual,
                weighted,
                state.radius,
                state.slope,
                shrink,
                pull,
                up,
                down,
                kind(rho),
            )
        done += count
        value = term.value(state.x) + prior.value(state.x, state.radius, state.slope)
        history.append((done, value))
        settled = _error(history) <= tolerance * value
        if progress is not None:
            progress(done, value * scale, None)
    gap = float("nan")
    if certify:
        kernels.project(state.dual, state.radius)
        gap = max(0.0, value - term.bound(state, prior)) / value if value > 0 else 0.0
    return Outcome(state, done, value, gap, settled or gap <= tolerance)


def _error(history: list[tuple[int, float]]) -> float:
    """How far the last objective is above the least, estimated; infinite while it is too early to tell.

    If it falls like C / k^p, the falls d from k/4 to k/2 and e from k/2 to k have the ratio 2^p, and the
    error is e / (2^p − 1). The theory grants p = 1, so p is not taken to be less, nor more before there is a
    d. Twice the estimate is for its own error.
    """
    done, value = history[-1]
    half = min(p for k, p in history if k <= done // 2)
    if done < 4 * _CHECK:
        return 2 * (half - value) if half > value else float("inf")
    quarter = min(p for k, p in history if k <= done // 4)
    fall = max(abs(half - value), np.finfo(float).tiny)
    return 2 * fall / max(1.0, (quarter - half) / fall - 1)
