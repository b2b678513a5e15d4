"""The iteration: majorise–minimise by memory gradient, its stopping rule and its certificate.

It minimises term(X) + Σ r ‖∇X − s‖₂ (maps are in units of λ; r = 1 and s = 0 but in reweighted passes). At
each map the prior lies under a quadratic that touches it there (`solver.kernels.prior`); the sum of data term
and quadratic is minimised over the plane of two directions, the preconditioned gradient and the last step.
The objective never rises, no step length is to be chosen, and there are no dual variables to carry. Source:
Chouzenoux, Idier, Moussaoui, "A majorize-minimize strategy for subspace optimization applied to image
restoration", IEEE Trans. Image Processing 2011 (memory gradient, algorithm 3MG).

The corner of the norm at 0 is rounded below ε, which falls from iteration to iteration for as long as the
rounding hides more of the objective than is still to be gained at this ε, and more than a small part of the
tolerance.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solver.kernels import prior as kernels
from solver.kernels import step as steps
from solver.prior import Prior, level
from solver.result import Progress

Image = NDArray[np.floating]

_EPSILON, _FALL, _PATIENCE = 1.0, 0.8, 0.3
"""The first ε, in units of λ (or the mean ‖∇X − s‖ where that is less), its fall in one iteration, and the
part of what is still to be gained that the rounding may hide before ε falls on. Measured: a slower or more
patient fall takes up to twice the iterations, a faster one settles further from the minimum."""

_LEAST = 0.01
"""The least first ε: a start that is nearly flat says nothing of the gradients to come."""

_ROUNDING = 0.125
"""Of the tolerance: what the rounding may hide of the objective in the end."""

_REFRESH = 20
"""Iterations after which the data term's gradient, till then updated, is computed anew against rounding."""


@dataclass(slots=True)
class State:
    """A map in the middle of an iteration; arrays are padded by two pixels, (C, rows + 4, columns + 4)."""

    x: Image
    radius: Image
    """λ by pixel, in units of λ: 1 everywhere unless the prior is weighted."""
    slope: Image
    """(C, 2, rows + 4, columns + 4), what `solver.slope` foretells, or (C, 2, 0, 0) = level."""
    epsilon: float = 0.0
    """Below which the corner of the norm was last rounded, in units of λ; 0 = not begun."""
    fit: float | None = None
    """The data term's value at this map, where it is known."""


class Term(Protocol):
    """A convex quadratic data term, all in units of λ."""

    @property
    def curvature(self) -> Image:
        """(rows + 4, columns + 4), positive where data fall: what stands for its operator's diagonal."""
        ...

    def gradient(self, x: Image, out: Image) -> None:
        """out ← its gradient at the padded map x."""
        ...

    def multiply(self, x: Image, out: Image) -> None:
        """out ← its operator (second derivative) times x."""
        ...

    def value(self, x: Image) -> float:
        """The term at a padded map."""
        ...

    def certify(self, state: State, dual: Image, prior: Prior) -> tuple[float, float]:
        """(its value, a lower bound of the least objective) from feasible duals; good near the optimum."""
        ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """The state reached, with iterations, objective, relative gap and whether the rule was met."""

    state: State
    iterations: int
    objective: float
    gap: float
    converged: bool


def start(initial: Image) -> State:
    """A state at the map (C, rows, columns)."""
    x = np.ascontiguousarray(np.pad(initial, [(0, 0), (kernels.PAD,) * 2, (kernels.PAD,) * 2]))
    return State(x, np.ones_like(x[0]), level(x))


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
    rounding: float | None = None,
) -> Outcome:
    """Run until the objective has settled.

    Args:
        tolerance: it stops where the error of the objective, estimated from its fall, is below this part of
            it.
        limit: the most iterations.
        scale: turns the objective into the caller's unit for `progress`.
        certify: compute the gap, which is NaN otherwise.
        rounding: the part of the objective that the rounded corner may hide; an eighth of the tolerance
            unless given. Duals settle much sooner at a fixed ε, so for a small gap give more.
    """
    hide = _ROUNDING * tolerance if rounding is None else rounding
    descent = _Descent(term, prior, state)
    fit = term.value(state.x) if state.fit is None else state.fit
    state.epsilon = state.epsilon or _first_epsilon(prior.norms(state.x, state.slope))
    history: list[float] = []
    settled = False
    while len(history) < limit and not settled:
        roughness, hidden, fall = descent.step(len(history) % _REFRESH == 0)
        value = fit + roughness
        history.append(value)
        fit -= fall
        error = _error(history)
        settled = bool(hidden <= hide * value and error <= tolerance * value)
        known = error if np.isfinite(error) else 0.0
        if hidden > max(0.5 * hide * value, _PATIENCE * known):
            state.epsilon *= _FALL
        if progress is not None and len(history) % 10 == 0:
            progress(len(history), value * scale, None)
    gap = float("nan")
    if certify:
        dual = prior.duals(state.x, state.radius, state.slope, state.epsilon)
        fit, least = term.certify(state, dual, prior)
    state.fit = fit
    value = fit + prior.value(state.x, state.radius, state.slope)
    if certify:
        gap = max(0.0, value - least) / value if value > 0 else 0.0
    return Outcome(state, len(history), value, gap, settled or gap <= tolerance)


def _first_epsilon(norms: Image) -> float:
    mean = float(norms[kernels.PAD : -kernels.PAD, kernels.PAD : -kernels.PAD].mean())
    return min(max(mean, _LEAST), _EPSILON) if mean > 0 else _EPSILON


class _Descent:
    """The arrays of one run."""

    def __init__(self, term: Term, prior: Prior, state: State) -> None:
        self._term, self._state = term, state
        kind = state.x.dtype
        self._weights = prior.weights.astype(kind) ** 2
        self._up = kernels.tables(prior.weights.astype(kind), state.x.shape[2] - 4)
        self._data, self._direction, self._step = (np.zeros_like(state.x) for _ in range(3))
        self._curved, self._curved_step = np.zeros_like(state.x), np.zeros_like(state.x)
        self._stiffness = np.zeros_like(state.radius)

    def step(self, refresh: bool) -> tuple[float, float, float]:
        """Move the map; the rounded prior before, what it hides, and the fall of the data term."""
        state, kind = self._state, self._state.x.dtype.type
        if refresh:
            self._term.gradient(state.x, self._data)
        sums = kernels.descend(
            state.x,
            state.slope,
            state.radius,
            kind(state.epsilon),
            self._up,
            self._weights,
            self._term.curvature,
            self._data,
            self._step,
            self._stiffness,
            self._direction,
        )
        value, hidden, along, across, data_along, data_across = sums
        self._term.multiply(self._direction, self._curved)
        bends = steps.curvatures(
            self._direction, self._step, self._curved, self._curved_step, self._stiffness, self._up
        )
        a, b = _least(bends[:3] + bends[3:], along, across)
        fall = -(a * data_along + b * data_across)
        fall -= 0.5 * (a * a * bends[3] + 2 * a * b * bends[4] + b * b * bends[5])
        steps.advance(
            kind(a),
            kind(b),
            state.x,
            self._data,
            self._direction,
            self._step,
            self._curved,
            self._curved_step,
        )
        return float(value), float(hidden), float(fall)


def _least(bends: NDArray[np.float64], along: float, across: float) -> tuple[float, float]:
    """(a, b) of the least a · along + b · across + ½ (a, b) H (a, b)ᵀ, H = [[zz, zd], [zd, dd]]."""
    zz, zd, dd = bends
    if zz <= 0:
        return 0.0, 0.0
    determinant = zz * dd - zd * zd
    # Parallel directions, and the first step, which has no other, leave one; float32 tells no more.
    if determinant <= 1e-5 * zz * dd:
        return -along / zz, 0.0
    return (zd * across - dd * along) / determinant, (zd * along - zz * across) / determinant


def _error(history: list[float]) -> float:
    """How far the last objective is above the least, estimated; infinite while it is too early to tell.

    Two falls over a third of the iterations each, the older d and the later e: if falls go on with the
    ratio e / d, what is left is e² / (d − e). Three times the estimate, and at least the last
    fall, is for falls that slow down.
    """
    span = max(3, len(history) // 3)
    if len(history) <= 2 * span:
        return float("inf")
    last, before, first = history[-1], history[-1 - span], history[-1 - 2 * span]
    older, later = max(first - before, 0.0), max(before - last, 0.0)
    ratio = min(later / older, 0.95) if older > 0 else 0.0
    return later * max(1.0, 3 * ratio / (1 - ratio))
