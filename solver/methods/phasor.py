"""`phasor`: fuse what a pixel really measures, a complex number, instead of its angle.

    y = amplitude · exp(2πi · distance / ambiguity range),   Z = exp(l + iφ) on the fused grid

A pixel at a depth edge averages the two phasors, not the two distances, and the noise is nearly uniform in
the complex plane, so dark samples need no weights. Log-amplitude and distance have penalties of their own
(see `solver.optimisation.factored`), weighed against the true likelihood: no λ is to be chosen, and a numeric
one is a factor on the penalties.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.kernels import mixing
from solver.kernels import resolution as phasors
from solver.optimisation.factored import MODEL, Factored
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.padding import cropped
from solver.optimisation.schedule import SCHEDULE, Step
from solver.preparation.consensus import BEYOND
from solver.preparation.problem import Problem, Solution
from solver.preparation.wrapping import nearest
from solver.result import Progress
from solver.runtime import team

_LOST = 3.0
"""A distance is lost where what a low-resolution pixel's samples say of it deviates by over a third of a
radian, by |Z| itself or by the mean of Z over two pixels: noise has a length, but no direction."""

_FAINT = 0.1
"""Part of the light around, over β, that the model errs by in a fused pixel; nothing at β = 1. One that has
less and lies 60° off is a swing below zero, and its distance is lost too: at 2 dark print came loose."""

_EDGE, _LEVEL = 0.004, 0.15
"""What is an edge: a step by so much of the ambiguity range from one neighbour of a cell to the other, beside
which neither side rises by more than that part of it. A third and three times it give the same errors."""

_PURE, _SURE, _ERROR, _DARK, _SEEN = 0.02, 0.15, 1.5, 10.0, 10.0
"""A cell nearer to a side than 2 % of the step has that side's phase. It may be more of the other side's
nevertheless where that one is ten times darker and seen by ten deviations: the cell's light tells. A share
that errs by 1.5 deviations of a cell's light, and by 0.15 at least, is far from a half or the cell stays
between the sides."""

_MISPLACED = 0.016
"""Part of how much light and distance change about a sample, over β, that the model errs by besides: where an
edge crosses a fused pixel, that pixel's mean stands for the whole of it. A bright thing has rings without."""

_ABOVE = 1e6
"""More than any phasor, in units of the RMS amplitude."""

_RENEWED = SCHEDULE[:-1]
"""Of a stream that is prepared anew, which starts from the data too: edges that a map of other frames has
found elsewhere hold out against sharp steps. With fewer steps a growing window's maps fall behind those of
`fuse`. The last step's rounds are those of the maps that follow."""

_FOLLOWED = (Step(1.0, 2),)
"""After an exchange of one frame, from the map before."""

_CHANGED = tuple(replace(step, eases=False) for step in (*SCHEDULE[4:8:2], *SCHEDULE[-3:-1]))
"""After one of more, where the scene changes, from the data: the map before swings where they contradict each
other. While they do the prior does not give way: one that is free swings."""

_TOLD = 150.0
"""Bluntness under which a map tells samples that it does not explain."""

_DISPUTED = 3e-4
"""Part of the samples that the other frames contradict from which others may be wrong unnoticed. On clean
frames nothing changes, but telling takes as long as a tenth of the descent."""


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:
    """Minimise E.

    Distances are given from the cut up to an ambiguity range more, NaN where |Z| is lost in its noise.
    """
    if problem.amplitude is None or problem.ambiguity_range is None:
        raise FusionInputError("phasor needs amplitude and ambiguity_range")
    if not problem.usual_light:
        raise FusionInputError("amplitude is 0 wherever there is a distance; phasor needs received light")
    before = None if initial is None else initial.course
    course, steps = (_begin(problem), SCHEDULE) if before is None else _go_on(problem, before)
    watch = course is not before and problem.contradicted > _DISPUTED
    taken, converged = _run(course, steps, problem.options.max_iterations, progress, watch)
    course.judge(followed=steps is _FOLLOWED)
    return _solution(problem, course, taken, converged, fresh=initial is None)


def _begin(problem: Problem) -> Factored:
    assert problem.amplitude is not None
    assert problem.ambiguity_range is not None
    light = problem.amplitude[np.isfinite(problem.distance)]
    scale = float(np.sqrt(np.mean(np.square(light, dtype=np.float64))))
    factor, options = problem.options.upsampling, problem.options
    samples = _samples(problem, scale, slice(None))
    term = AreaTerm(*samples, problem.positions, factor, options.footprint, margin=BEYOND * factor)
    strength = 1.0 if options.regularization == "auto" else float(options.regularization)
    weight = 1 / ((_component(problem) / scale) ** 2 + MODEL**2)
    noise = float(1 / np.sqrt(weight * len(problem.distance)))
    least = _radians(problem, nearest(problem.ambiguity_range, problem.cut))
    return Factored(term, scale, weight, noise, least, strength, options.neighbourhood)


def _go_on(problem: Problem, course: Factored) -> tuple[Factored, Sequence[Step]]:
    """Where the descent of a stream's next problem begins, and its steps."""
    if len(problem.exchanged) != 1:
        return _begin(problem), _CHANGED if problem.exchanged else _RENEWED
    slot = slice(problem.exchanged[0], problem.exchanged[0] + 1)
    samples = _samples(problem, course.scale, slot)
    course.term.exchange(slot.start, *samples, problem.positions[slot], course.z)
    return course, _FOLLOWED


def _run(
    course: Factored, steps: Sequence[Step], limit: int, progress: Progress | None, watch: bool
) -> tuple[int, bool]:
    """Rounds taken, and whether all steps were; `watch`: with an eye on samples that the map contradicts."""
    taken = 0
    for number, step in enumerate(steps, 1):
        taken += course.descend(step, limit - taken)
        if watch and step.blunt < _TOLD:
            course.distrust()
        if progress is not None:
            progress(taken, None, None)  # the objective would cost as much as some rounds
        if taken >= limit:
            return taken, number == len(steps)
    return taken, True


def _component(problem: Problem) -> float:
    """The deviation of either component of a sample, in the amplitude's unit."""
    return _radians(problem, problem.noise)


def _radians(problem: Problem, distance: float) -> float:
    assert problem.ambiguity_range is not None
    return 2 * np.pi / problem.ambiguity_range * distance


def _solution(problem: Problem, course: Factored, taken: int, converged: bool, fresh: bool) -> Solution:
    assert problem.ambiguity_range is not None
    shape, scale = problem.fused_shape, problem.ambiguity_range / (2 * np.pi)
    distance, amplitude = cropped(course.state, shape).copy()
    seen = cropped(course.term.curvature[None], shape)[0].copy()
    least = _LOST * _component(problem) / (course.scale * problem.options.upsampling)
    side = 2 * problem.options.upsampling + 1
    mean = np.stack([cv2.blur(part, (side, side)) for part in cropped(course.z, shape).copy()])
    cut = np.float32(_radians(problem, problem.cut))
    factor = problem.options.upsampling
    faint = np.float32((_FAINT / factor) ** 2 if factor > 1 else 0.0)
    units = np.float32(scale), np.float32(course.scale), cut, np.float32(least**2), faint
    team.share(phasors.resolve, distance, amplitude, seen, mean, *units)
    distance = _settled(problem, course, distance, amplitude)
    information = cropped(course.information()[None], shape)[0] * np.float32(1 / scale**2)
    return Solution(
        distance,
        amplitude,
        course.strength,
        taken,
        course.objective() if fresh else None,
        None,
        converged,
        information=information,
        course=course,
    )


def _settled(
    problem: Problem, course: Factored, distance: NDArray[np.float32], amplitude: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The map, cells that two surfaces share being given to the one that has more area, not more light."""
    assert problem.ambiguity_range is not None
    turn, out = problem.ambiguity_range, np.empty_like(distance)
    noise = course.noise * course.scale
    law = _PURE, _SURE, _DARK, _SEEN * noise, _ERROR * noise * problem.options.upsampling**2
    bounds = turn, problem.cut, _EDGE * turn, _LEVEL
    team.share(mixing.settle, distance, amplitude, *bounds, law, out)
    return out


def _contrast(values: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(n, H, W): by how much phasors (2, n, H, W) differ about a pixel, squared; of those that are known."""
    about, out = np.ones((3, 3), np.uint8), np.zeros(values.shape[1:], np.float32)
    most, least = np.where(known, values, np.float32(-_ABOVE)), np.where(known, values, np.float32(_ABOVE))
    for high, low in zip(most, least, strict=True):
        for top, bottom, square in zip(high, low, out, strict=True):
            square += np.square(cv2.dilate(top, about) - cv2.erode(bottom, about))
    return np.where(known, out, 0)


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
    known = np.isfinite(distance) & (problem.amplitude[frames] > 0)
    values = np.where(known, values, 0)
    variance = np.float32((_component(problem) / unit) ** 2 + MODEL**2)
    misplaced = np.float32((_MISPLACED / problem.options.upsampling) ** 2)
    weights = variance / (variance + misplaced * _contrast(values, known))
    return values, np.where(known, weights, 0)
