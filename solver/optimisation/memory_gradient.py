"""The iteration: majorise–minimise by memory gradient, its stopping rule and its certificate.

It minimises term(X) + Σ r ‖∇X − s‖₂ (maps are in units of λ; r = 1 and s = 0 but in reweighted passes). At
each map the prior lies under a quadratic that touches it there (`solver.kernels.group`); the sum of data term
and quadratic is minimised over the plane of two directions, the preconditioned gradient and the last step.
The objective never rises, no step length is to be chosen, and there are no dual variables to carry. Where it
takes long, every other bout of iterations has a direction from all grids (`optimisation.levels`). Source:
Chouzenoux, Idier, Moussaoui, "A majorize-minimize strategy for subspace optimization applied to image
restoration", IEEE Trans. Image Processing 2011 (memory gradient, algorithm 3MG).

The corner of the norm at 0 is rounded below ε, which falls from iteration to iteration for as long as the
rounding hides more of the objective than is still to be gained at this ε, and more than a small part of the
tolerance.
"""

from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.kernels import iteration as loop
from solver.kernels import majorant
from solver.kernels.group import PAD
from solver.optimisation.levels import Levels
from solver.optimisation.prior import Prior
from solver.optimisation.term import State, Term
from solver.result import Progress
from solver.runtime import team

Image = NDArray[np.floating]

_EPSILON, _FALL, _PATIENCE = 1.0, 0.8, 0.3
"""The first ε, in units of λ (or the mean ‖∇X − s‖ where that is less), its fall in one iteration, and the
part of what is still to be gained that the rounding may hide before ε falls on. A slower or more
patient fall takes more iterations, a faster one settles further from the minimum."""

_LEAST = 0.01
"""The least first ε: a start that is nearly flat says nothing of the gradients to come."""

_ROUNDING = 0.125
"""Of the tolerance: what the rounding may hide of the objective in the end."""

_BOUT = 10
"""Iterations between two reports of progress; between them nothing is heard, an interrupt neither."""

_CREEPING = 60
"""Iterations of one kind, after which come as many of the other: those whose direction is made on several
grids cost more, and few scenes need any; where the rounding is fine, they in turn lag at single pixels."""

_REFRESH = 20
"""Iterations after which the data term's gradient, till then updated, is computed anew against rounding."""


class Memory:
    """What iterations leave to the next ones: above all the last step."""

    def __init__(self, x: Image, diagonal: bool) -> None:
        """For a map like x; `diagonal` as the data term's operator."""
        none = np.zeros((len(x), 0, 0), x.dtype)
        self._step, self._direction = _zeros(x), _zeros(x)
        # The data term's gradient, and the operator's products with direction and step.
        self._gradient, self._curved, self._curved_step = (
            (none, none, none) if diagonal else (_zeros(x), _zeros(x), _zeros(x))
        )
        self._stiffness = np.zeros((x.shape[1] - 2 * PAD, x.shape[2]), x.dtype)
        self._sums = np.zeros((x.shape[1] - 2 * PAD, 11))
        self._bent = 0.0

    def forget(self) -> None:
        """Begin without a last step: its products with another operator would have to be made anew."""
        self._step[:] = 0
        self._bent = 0.0

    def iterate(
        self,
        term: Term,
        prior: Prior,
        state: State,
        numbers: NDArray[np.float64],
        history: NDArray[np.float64],
        rule: tuple[float, float, float, float, int, int],
    ) -> None:
        """Fill `history`, or stop where the objective has settled; see `solver.kernels.iteration`."""
        x, operator, none = state.x, term.operator(), self._curved[:, :0, :0]
        footprint: Any = operator.footprint or (none, none, np.zeros(0, x.dtype), 0)
        ties = operator.ties or (np.zeros((6, 0, 0), np.uint8), np.zeros(0, x.dtype), none)
        weights = (prior.squared(x), term.curvature)
        data = self._gradient if operator.mean is None else operator.mean
        steps = (self._step, self._direction, self._curved, self._curved_step)
        numbers[loop.BENT] = self._bent
        team.run(
            loop.iterate,
            (x, state.slope, state.radius),
            (*weights, footprint, ties),
            (data, *steps, self._stiffness),
            self._sums,
            rule,
            numbers,
            history,
        )
        self._bent = float(numbers[loop.BENT])

    def iterate_on_levels(
        self,
        term: Term,
        prior: Prior,
        state: State,
        numbers: NDArray[np.float64],
        history: NDArray[np.float64],
        rule: tuple[float, float, float, float, int, int],
    ) -> None:
        """The same, with the direction of `optimisation.levels`."""
        x, operator = state.x, term.operator()
        dense = operator.footprint is not None
        weights, inner = prior.squared(x), np.s_[PAD:-PAD, PAD:-PAD]
        levels = Levels(term.curvature[inner])
        stiffness, diagonal = np.zeros(x.shape[1:], x.dtype), np.zeros_like(x[0][inner])
        gradient = np.zeros((len(x), *diagonal.shape), x.dtype)
        data = self._gradient if dense else np.zeros_like(x)
        numbers[loop.BENT] = self._bent
        epsilon, fit, count, _, bent = numbers
        settled = False
        while count < len(history) and not settled:
            if operator.mean is not None:
                np.multiply(term.curvature, x - operator.mean, out=data)
            elif count % _REFRESH == 0:
                operator.gradient(x, data)
            own = x.dtype.type(epsilon)
            team.share(
                majorant.stiffnesses, x, state.slope, state.radius, own, weights, stiffness, self._sums
            )
            given = (x, state.slope, stiffness, weights, prior.tables(x), data, term.curvature)
            team.share(majorant.gradients, *given, gradient, diagonal)
            levels.stiffen(stiffness[inner] * x.dtype.type(len(prior.offsets)))
            for pull, direction in zip(gradient, self._direction, strict=True):
                np.negative(levels.precondition(pull, diagonal), out=direction[inner])
            if dense:
                operator.multiply(self._direction, self._curved)
            given = (gradient, data, self._direction, self._step, self._curved, term.curvature, stiffness)
            team.share(majorant.products, *given, weights, self._sums)
            a, b, fit, bent, epsilon, settled = loop.decide(
                history, int(count), self._sums, fit, bent, epsilon, rule
            )
            _advance(a, b, self._direction, self._step, x)
            if dense:
                _advance(a, b, self._curved, self._curved_step, data)
            count += 1
        numbers[:] = epsilon, fit, count, settled, bent
        self._bent = float(bent)


def _advance(a: float, b: float, direction: Image, step: Image, to: Image) -> None:
    """step ← a · direction + b · step, which is added to `to`."""
    step *= step.dtype.type(b)
    step += direction.dtype.type(a) * direction
    to += step


@dataclass(frozen=True, slots=True)
class Outcome:
    """The state reached, with iterations, objective, relative gap and whether the rule was met."""

    state: State
    memory: Memory
    iterations: int
    objective: float
    gap: float
    converged: bool


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
    window: int = 3,
    memory: Memory | None = None,
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
        window: the least number of iterations over which a fall of the objective is measured; a start near
            the minimum needs no more than one.
        memory: of a run before on a term of the same kind, whose arrays are used again.
    """
    hide = _ROUNDING * tolerance if rounding is None else rounding
    if memory is None:
        memory = Memory(state.x, diagonal=term.operator().footprint is None)
    else:
        memory.forget()
    fit = term.value(state.x) if state.fit is None else state.fit
    finest = _finest(state.x)
    nothing = 2 * finest * state.radius.size
    epsilon = state.epsilon or _first_epsilon(prior.norms(state.x, state.slope))
    epsilon = epsilon if epsilon > finest else _LEAST
    numbers = np.array([epsilon, fit, 0.0, 0.0, 0.0])
    rule = (tolerance, hide, _FALL, _PATIENCE, _REFRESH, window)
    before, history, settled = 0, np.zeros(0), False
    kinds = cycle((memory.iterate_on_levels, memory.iterate))
    iterate = memory.iterate
    while before + len(history) < limit and not settled:
        if len(history) >= _CREEPING:
            # Falls of another direction tell nothing about what this one leaves.
            before, history, iterate = before + len(history), np.zeros(0), next(kinds)
            numbers[loop.DONE] = 0
        history = np.append(history, np.zeros(min(_BOUT, limit - before - len(history))))
        iterate(term, prior, state, numbers, history, rule)
        count = int(numbers[loop.DONE])
        settled = bool(numbers[loop.SETTLED]) or history[count - 1] <= nothing
        numbers[loop.EPSILON] = max(numbers[loop.EPSILON], finest)
        history = history[:count]
        if progress is not None:
            progress(before + count, float(history[-1]) * scale, None)
    state.epsilon, fit = float(numbers[loop.EPSILON]), float(numbers[loop.FIT])
    gap = float("nan")
    if certify:
        dual = prior.duals(state.x, state.radius, state.slope, state.epsilon)
        fit, least = term.certify(state, dual, prior)
    state.fit = fit
    value = fit + prior.value(state.x, state.radius, state.slope)
    if certify:
        gap = max(0.0, value - least) / value if value > 0 else 0.0
    return Outcome(state, memory, before + len(history), value, gap, settled or gap <= tolerance)


def _first_epsilon(norms: Image) -> float:
    mean = float(norms[PAD:-PAD, PAD:-PAD].mean())
    return min(max(mean, _LEAST), _EPSILON) if mean > 0 else _EPSILON


def _finest(x: Image) -> float:
    """The differences that a map's own rounding makes; ε does not fall below them.

    Only where there is next to no gradient would it, as in a constant scene without noise, until ε² vanishes.
    """
    return float(np.finfo(x.dtype).eps) * max(1.0, float(x.max()), -float(x.min()))


def _zeros(like: Image) -> Image:
    """Fresh memory, which is zero by itself: np.zeros_like would walk it all."""
    return np.zeros(like.shape, like.dtype)
