"""Frames one after another, each aligned with the mosaic of those before it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import RegistrationError
from solver.registration.alignment import ALIASED, DENSITY, FEWEST, OVERLAP, SMOOTHING
from solver.registration.equations import POSITION_ERROR, Equations, normal_equations
from solver.registration.grid import Grid, Place
from solver.registration.mosaic import Mosaic
from solver.registration.motion import Motion, Shift, Turn
from solver.registration.points import Points
from solver.registration.samples import Samples, Scaling, pyramid, scaling
from solver.registration.start import find_start
from solver.registration.steps import solve_steps
from solver.registration.sums import Sums

Float = NDArray[np.float64]
Image = NDArray[np.float32]

STEPS = 5  # at most per level
SWEEPS = 1  # of conjugate gradients per frame, as each mosaic starts from the one before
COARSE_STEP, STEP = 0.2, 0.03  # pixels; the next step would be about a tenth of it
ANCHOR = 0.3  # share of the first frames; with 0.05 a stream drifts by 0.01–0.03 px in 600 frames
GUESS = 2.0  # pixels; deviation of a first guess


class Track:
    """The mosaic of the latest frames, and where the next one looks.

    Positions are those of `register`: (2,) displacements or (3,) rotation vectors, relative to a frame at
    rest, which all frames must overlap. An older frame counts less by 1/span with every frame after it, so
    that the sums of the mosaic's normal equations are all that is kept. A part of the first span of frames
    stays for good: each frame follows those before it with a small error, and the sum of these would drift.

    Args:
        span: how many frames the mosaic is made of.
        intrinsics, distortion, ambiguity_range: as for `register`.
    """

    def __init__(
        self,
        span: int,
        intrinsics: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        ambiguity_range: float | None = None,
    ) -> None:
        self._motion: Motion = Shift() if intrinsics is None else Turn.of(intrinsics, distortion)
        self._range = ambiguity_range
        self._span, self._added = span, 0
        self._scaling: Scaling | None = None
        self._layers: list[_Layer] = []
        self._latest: tuple[Samples, Float] | None = None
        self._misfits: list[float] = []

    def add(self, distance: Image, amplitude: Image | None, position: Float) -> None:
        """Add a frame (H, W) that looks where `position` says."""
        self._add(self._prepared(distance, amplitude), _parameters(position))

    def follow(self, distance: Image, amplitude: Image | None, guess: Float) -> Float:
        """Find where a frame (H, W) looks, from a first guess, and add it.

        Raises:
            RegistrationError: it does not fit; nothing was added.
        """
        levels = self._prepared(distance, amplitude)
        used = float((levels[0].weights > 0).mean())
        if used < FEWEST:
            raise RegistrationError(
                f"{100 * used:.1f} % of its pixels are valid; at least {100 * FEWEST:.0f} % are needed"
            )
        prior = _parameters(guess)
        found, equations = self._refined(levels, self._started(levels, prior, guided=True), prior)
        misfit = self._misfit(equations)
        if misfit:
            found, equations = self._refined(levels, self._started(levels, prior, guided=False), prior)
            misfit = self._misfit(equations)
        if misfit:
            raise RegistrationError(misfit)
        self._misfits = [*self._misfits[-14:], float(equations.misfit[0])]
        self._add(levels, found)
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
        found = find_start(pair, levels[0].shape, 0, guess, self._motion, guided)
        return prior if (found == guess).all() else self._motion.moved(found[1:], position)

    def _refined(self, levels: list[Samples], start: Float, prior: Float) -> tuple[Float, Equations]:
        """Gauss–Newton against the mosaic's levels, coarse to fine."""
        unit = self._motion.unit()
        stiffness = 1 / (GUESS * unit) ** 2
        position = start
        for layer, samples in zip(self._layers[::-1], levels[len(self._layers) - 1 :: -1], strict=True):
            points = layer.points(samples)
            enough = STEP if layer is self._layers[0] else COARSE_STEP
            for _ in range(STEPS):
                place = self._motion.place(points, position)
                equations = normal_equations(points, place, layer.mosaic, self._motion, layer.error)
                steps, _ = solve_steps(equations, prior - position, stiffness, unit)
                limit = 2.0 ** (len(levels) - 1) * unit
                steps = np.clip(steps, -limit, limit)
                position = self._motion.moved(position, steps)
                if np.abs(steps / unit).max() < enough:
                    break
        return position, equations

    def _misfit(self, equations: Equations) -> str:
        """Why a frame does not fit; empty where it does."""
        overlap, misfit = equations.overlap[0], equations.misfit[0]
        if overlap < OVERLAP:
            return f"overlaps the others by {100 * overlap:.0f} %; {100 * OVERLAP:.0f} % are needed"
        usual = float(np.median(self._misfits)) if self._misfits else misfit
        if misfit > max(1.5, 1.6 * usual):
            return f"residual {misfit:.1f} deviations, {usual:.1f} is usual"
        return ""

    def _add(self, levels: list[Samples], position: Float) -> None:
        if not self._layers:
            self._layers = [_Layer(samples, self._motion) for samples in levels[:2]]
        for layer, samples in zip(self._layers, levels, strict=False):
            layer.add(samples, position, 1 - 1 / self._span)
        self._latest = levels[-1], position
        self._added += 1
        if self._added == self._span:
            for layer in self._layers:
                layer.hold()


class _Layer:
    """The mosaic at one level of resolution."""

    def __init__(self, samples: Samples, motion: Motion) -> None:
        self._motion = motion
        self._base = motion.base(samples)
        self._sums: Sums | None = None
        self.error = ALIASED
        self.mosaic: Mosaic

    def points(self, samples: Samples) -> Points:
        """All samples of a frame."""
        return Points.of(samples, self._base, np.ones(1, dtype=np.bool_))

    def add(self, samples: Samples, position: Float, keep: float) -> None:
        """Weaken what there is, and add a frame."""
        points = self.points(samples)
        place = self._motion.place(points, position)
        if self._sums is None:
            self._sums = Sums(Grid.over(place, points.shape, DENSITY), len(samples.values))
            start = None
        else:
            self.error = POSITION_ERROR
            self._sums.fade(keep)
            start = self._extended(self._sums, place, points.shape)
        self._sums.add(points, place)
        self.mosaic = self._sums.solve(smoothing=SMOOTHING, sweeps=SWEEPS, start=start)

    def hold(self) -> None:
        """Keep a part of the mosaic for good."""
        if self._sums is not None:
            self._sums.hold(ANCHOR)

    def _extended(self, sums: Sums, place: Place, shape: tuple[int, int]) -> Image:
        """The mosaic as a start, on a grid that holds the new frame too."""
        borders = sums.grid.lacking(place, shape)
        if not any(map(any, borders)):
            return self.mosaic.values
        sums.extend(borders)
        return np.pad(self.mosaic.values, ((0, 0), *borders), mode="edge")


def _parameters(position: Float) -> Float:
    """(1, 3) as the motion has them."""
    return np.concatenate([position, np.zeros(3 - len(position))])[None]
