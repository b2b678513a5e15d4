"""Frames one after another, each aligned with the mosaic of those before it."""

from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import RegistrationError
from solver.registration.equations import POSITION_ERROR, Equations, normal_equations
from solver.registration.fading import FadingSums
from solver.registration.fit import OVERLAP
from solver.registration.grid import Grid
from solver.registration.misfit import Misfit
from solver.registration.mosaic import Mosaic, halved
from solver.registration.motion import Motion, Rotation, Shift
from solver.registration.placement import ALIASED, DENSITY, SMOOTHING
from solver.registration.point_samples import Points
from solver.registration.reference import why_too_few
from solver.registration.samples import Samples, Scaling, pyramid, scaling
from solver.registration.start import find_start, period
from solver.registration.steps import solve_steps

Float = NDArray[np.float64]
Image = NDArray[np.float32]

STEPS = 5  # at most per level
COARSE_STEP, STEP = 0.2, 0.03  # pixels; the next step would be about a tenth of it
ANCHOR = 0.3  # share of the first frames; with 0.05 a stream drifts by 0.01–0.03 px in 600 frames
GUESS = 2.0  # pixels; deviation of a first guess
LARGEST = 4.0  # pixels a step


class Track:
    """The mosaic of the latest frames, and where the next one looks.

    Positions are those of `register`: (2,) displacements or (3,) rotation vectors, relative to a frame at
    rest, which all frames must overlap. An older frame counts less by 1 / horizon with every frame after it,
    so that the sums of the mosaic's normal equations are all that is kept. A part of the first frames stays
    for good: each frame follows those before it with a small error, and the sum of these would drift.

    Args:
        horizon: how many frames the mosaic is made of.
        intrinsics, distortion, ambiguity_range: as for `register`.

    Attributes:
        period: as of `Registration`, of the newest frame that it began with; None where it began with none.
    """

    def __init__(
        self,
        horizon: int,
        intrinsics: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        ambiguity_range: float | None = None,
    ) -> None:
        self._motion: Motion = Shift() if intrinsics is None else Rotation.of(intrinsics, distortion)
        self._range = ambiguity_range
        self._horizon, self._added = horizon, 0
        self._scaling: Scaling | None = None
        self._bases: list[Image] = []
        self._sums: FadingSums | None = None
        self._mosaics: list[Mosaic] = []
        self._latest: tuple[Samples, Float] | None = None
        self._misfit: Misfit | None = None
        self._misfits: list[float] = []
        self.period: float | None = None

    def begin(self, distance: Image, amplitude: Image | None, positions: list[Float]) -> None:
        """Add frames (N, H, W) that look where positions say; all of them tell what is usual."""
        self._scaling = scaling(distance, amplitude, self._range)
        lights = [None] * len(distance) if amplitude is None else list(amplitude)
        for frame, light, position in zip(distance, lights, positions, strict=True):
            self.add(frame, light, position)
        self.period = period(self._prepared(distance[-1], lights[-1]), 0)

    def add(self, distance: Image, amplitude: Image | None, position: Float) -> None:
        """Add a frame (H, W) that looks where `position` says."""
        levels = self._prepared(distance, amplitude)
        points, place = self._points(levels[0]), _parameters(position)
        if self._mosaics:
            self._remember(self._equations(points, place))
        self._add(levels, points, place)

    def follow(self, distance: Image, amplitude: Image | None, guess: Float, *, guided: bool = True) -> Float:
        """Find where a frame (H, W) looks, from a first guess, and add it.

        Looked for next to the guess; where it does not fit there, and unless it is `guided`, up to a quarter
        of the image away from the latest frame too.

        Raises:
            RegistrationError: it does not fit; nothing was added.
        """
        levels = self._prepared(distance, amplitude)
        points = [self._points(samples) for samples in levels[:2]]
        too_few = why_too_few(levels[0].weights)
        if too_few:
            raise RegistrationError(too_few)
        prior = _parameters(guess)
        near = self._started(levels, prior, guided=True)
        found, equations = self._refined(points, near, prior)
        misfit = self._why_not(equations)
        if misfit or not guided:
            far = self._started(levels, prior, guided=False)
            if (far != near).any():
                elsewhere = self._refined(points, far, prior)
                why = self._why_not(elsewhere[1])
                if not why and (misfit or elsewhere[1].misfit < equations.misfit):
                    (found, equations), misfit = elsewhere, ""
        if misfit:
            raise RegistrationError(misfit)
        self._remember(equations)
        self._add(levels, points[0], found)
        return found[0, : len(guess)]

    def _prepared(self, distance: Image, amplitude: Image | None) -> list[Samples]:
        frame, light = distance[None], None if amplitude is None else amplitude[None]
        if self._scaling is None:
            self._scaling = scaling(frame, light, self._range)
        return pyramid(self._scaling(frame, light))

    def _started(self, levels: list[Samples], prior: Float, guided: bool) -> Float:
        """The guess, or a place near it or anywhere that is better by the latest frame."""
        if self._latest is None:
            return prior
        samples, position = self._latest
        pair = samples.joined(levels[-1])
        guess = self._motion.relative(np.concatenate([position, prior]), 0)
        found = find_start(pair, levels[0].shape, 0, guess, self._motion, guided, self.period)
        return prior if (found == guess).all() else self._motion.moved(found[1:], position)

    def _points(self, samples: Samples) -> Points:
        while len(self._bases) <= samples.level:
            self._bases.append(self._motion.base(samples))
        return Points.of(samples, self._bases[samples.level], np.ones(1, dtype=np.bool_))

    def _refined(self, points: list[Points], start: Float, prior: Float) -> tuple[Float, Equations]:
        """Gauss–Newton against the mosaic's levels, coarse to fine."""
        unit = self._motion.unit()
        stiffness = 1 / (GUESS * unit) ** 2
        limit = LARGEST * unit
        position = start
        for level in reversed(points):
            enough = COARSE_STEP if level.level else STEP
            for _ in range(STEPS):
                equations = self._equations(level, position)
                steps, _ = solve_steps(equations, prior - position, stiffness, unit)
                steps = np.clip(steps, -limit, limit)
                position = self._motion.moved(position, steps)
                if np.abs(steps / unit).max() < enough:
                    break
        return position, equations

    def _equations(self, points: Points, position: Float) -> Equations:
        place, mosaic = self._motion.place(points, position), self._mosaics[points.level]
        error = ALIASED if self._added == 1 else POSITION_ERROR
        return normal_equations(points, place, mosaic, self._motion, error)

    def _remember(self, equations: Equations) -> None:
        self._misfits = [*self._misfits[-14:], float(equations.misfit[0])]

    def _why_not(self, equations: Equations) -> str:
        """Why a frame does not fit; empty where it does."""
        overlap, misfit = equations.overlap[0], equations.misfit[0]
        if overlap < OVERLAP:
            return f"overlaps the others by {100 * overlap:.0f} %; {100 * OVERLAP:.0f} % are needed"
        usual = median(self._misfits) if self._misfits else misfit
        if misfit > max(1.5, 1.6 * usual):
            return f"residual {misfit:.1f} deviations, {usual:.1f} is usual"
        return ""

    def _add(self, levels: list[Samples], points: Points, position: Float) -> None:
        place = self._motion.place(points, position)
        if self._sums is None:
            grid = Grid.over(place, points.shape, DENSITY)
            self._sums = FadingSums(grid, points.values.shape[1], 1 - 1 / self._horizon)
            self._misfit = Misfit(grid.size) if points.bent else None
        else:
            borders = self._sums.grid.lacking(place, points.shape)
            if self._misfit is not None:
                self._misfit.add(points, place, self._mosaics[0])
                self._misfit.extend(borders)
            self._sums.extend(borders)
        self._sums.add(points, place)
        self._added += 1
        if self._added == self._horizon:
            self._sums.hold(ANCHOR)
        mosaic = self._sums.advance(SMOOTHING)
        if self._misfit is not None:
            mosaic = replace(mosaic, misfit=self._misfit.image())
            self._misfit.fade(1 - 1 / self._horizon)
        self._mosaics = [mosaic] if len(levels) == 1 else [mosaic, halved(mosaic)]
        self._latest = levels[-1], position


def _parameters(position: Float) -> Float:
    """(1, 3) as the motion has them."""
    return np.concatenate([position, np.zeros(3 - len(position))])[None]
