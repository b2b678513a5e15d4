"""Hierarchical Lucas–Kanade, first against the reference, then all frames against their mosaic."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.errors import RegistrationError
from solver.registration.equations import POSITION_ERROR, Equations, normal_equations
from solver.registration.fit import FITS, STANDS_OUT, SUSPECT, misfits
from solver.registration.grid import Grid, Place
from solver.registration.misfit import Misfit
from solver.registration.mosaic import Mosaic, resampled
from solver.registration.motion import Motion
from solver.registration.point_samples import Points
from solver.registration.samples import Samples
from solver.registration.start import find_start, seek_shifts, start_at
from solver.registration.steepness import finer_blocks, steep_blocks
from solver.registration.steps import solve_steps
from solver.registration.sums import COLD, Sums

Float = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

FEWEST = 0.05  # share of valid pixels under which a frame cannot be placed
STEP = 0.03  # pixels; the next step would be a fifth of it
RELAXATION = 1.2  # a step against the common mosaic falls short, as each frame is part of it
COARSE_STEP = 0.2  # pixels; the finer level goes on
ALIASED = 0.2  # pixels; position error of a mosaic of one frame, whose edges alias
DENSITY = 1.83  # nodes per pixel; two is the Nyquist limit of the footprint's first zero, 1.6 blurs
PAIRWISE, COARSE, FINE = 4, 4, 4  # steps at most
BENT_RELAXATION, BENT_FINE, BENT_STEP = 1.4, 6, 0.02  # where edges count for less, steps fall shorter
ENOUGH = 0.5  # pixels
SAME = 2.0  # pixels, from where refinement ends in the same place
SMOOTHING = 3.0  # λ; a tenth lets noise into the mosaic and biases high noise, ten times blurs it
SWEEPS = 2  # per Gauss–Newton step; six times as many change nothing


class Alignment:
    """One registration under way."""

    def __init__(
        self,
        levels: list[Samples],
        motion: Motion,
        reference: int,
        guess: Float,
        guided: bool,
        rejected: dict[int, str],
    ) -> None:
        self.levels = levels
        self.motion = motion
        self.reference = reference
        self.parameters = motion.relative(guess, reference)
        self.guess = self.parameters
        self.guided = guided
        self.rejected = rejected
        self.covariance = np.zeros((len(guess), 3, 3))

    @property
    def count(self) -> int:
        return len(self.parameters)

    @property
    def active(self) -> NDArray[np.bool_]:
        keep = np.ones(self.count, dtype=bool)
        keep[list(self.rejected)] = False
        return keep

    def drop_empty(self) -> None:
        """Reject frames without enough valid pixels."""
        used = (self.levels[0].weights > 0).mean(axis=(1, 2))
        for k in np.flatnonzero(used < FEWEST):
            what = f"{100 * used[k]:.1f} % of its pixels are valid; at least {100 * FEWEST:.0f} % are needed"
            if k == self.reference:
                raise RegistrationError(f"frame {k}, the reference, cannot be used: {what}")
            self.rejected[int(k)] = what

    def align(self) -> None:
        """Place all frames; reject those that do not fit.

        A guess that no search improves is refined at once, and so is one with which every frame then fits to
        its noise, whatever a search finds: texture that repeats looks alike in other places too. Only where a
        frame does not fit is each aligned with the reference first; and one that still does not is looked
        for pixel by pixel before it is rejected.
        """
        found = self._searched(self.guided)
        trusted = self.guided and bool((found == self.guess).all())
        together = None
        if self.guided and not trusted:
            equations = self._align_together()
            if not self._misfits(equations) and equations.misfit[self.active].max() < FITS:
                return
            together = self._confirmed(equations, found)
        elif not trusted:
            self._align_with_reference(found)
        sought = False
        for _ in range(5):  # rejecting a frame changes the mosaic, so the rest is refined again
            equations = together or self._align_together()
            together, wrong = None, self._misfits(equations)
            if not sought and not trusted:
                sought = True
                equations = self._sought(equations)
                wrong = self._misfits(equations)
            if not wrong:
                return
            if trusted:
                trusted = False
                self._align_with_reference(found)
            else:
                self._reject(wrong)

    def _confirmed(self, equations: Equations, found: Float) -> Equations | None:
        """Align each with the reference; the equations if all lie where these place them, None otherwise."""
        places, covariance, rejected = self.parameters, self.covariance, len(self.rejected)
        self._align_with_reference(found)
        if len(self.rejected) > rejected or self._apart(places) > SAME:
            return None
        self.parameters, self.covariance = places, covariance
        return equations

    def _sought(self, equations: Equations) -> Equations:
        """Have frames that may lie elsewhere looked for; the equations of the places that fit better."""
        suspects = list(self._misfits(equations, SUSPECT if not self.guided else STANDS_OUT))
        if not suspects:
            return equations
        kept = self.parameters.copy()
        self._seek(suspects)
        again = self._align_together()
        if again.misfit[suspects].mean() < equations.misfit[suspects].mean():
            return again
        self.parameters = kept
        return equations

    def _seek(self, frames: list[int]) -> None:
        """Start frames anew from where they resemble the reference most, at full resolution."""
        shifts = seek_shifts(self.levels[0], self.reference, frames)
        self.parameters[frames] = start_at(shifts, self.levels[0].shape, self.motion)

    def _align_with_reference(self, start: Float) -> None:
        """Refine each frame against the reference alone; search anew where a guess was wrong."""
        self.parameters = start
        equations = self._refine_pairwise(self.levels[-1])
        wrong = self._misfits(equations)
        if self.guided and wrong:
            kept = self.parameters
            self.parameters = self._searched(guided=False)
            again = self._refine_pairwise(self.levels[-1])
            better = np.zeros(self.count, dtype=bool)
            better[list(wrong)] = again.misfit[list(wrong)] < equations.misfit[list(wrong)]
            self.parameters = np.where(better[:, None], self.parameters, kept)
            wrong = {k: why for k, why in wrong.items() if not better[k]}
        if wrong:
            self._seek(list(wrong))
            still = self._misfits(self._refine_pairwise(self.levels[0]))
            self._reject({k: why for k, why in still.items() if k in wrong})

    def _align_together(self) -> Equations:
        """Refine all frames against their common mosaic, coarse to fine, where the coarser one is steep.

        A lone channel is looked at everywhere but on the finest level: distance is bent at its steepest
        edges, where pixels mix, and what is less steep has to outweigh them.
        """
        blocks, coarser = None, None
        for samples in self.levels[:0:-1]:
            if len(samples.values) == 1:
                blocks = None
            points = self._points(samples, blocks)
            coarser = self._refine_jointly(points, coarser)
            within = self.active[:, None, None] if blocks is None else finer_blocks(blocks, samples.shape)
            blocks = steep_blocks(coarser.kind, coarser.grid, points, self._place(points)) & within
        return self._refine_staggered(self._points(self.levels[0], blocks), coarser)

    def _searched(self, guided: bool) -> Float:
        coarse, shape = self.levels[-1], self.levels[0].shape
        return find_start(coarse, shape, self.reference, self.guess, self.motion, guided)

    def _refine_pairwise(self, samples: Samples) -> Equations:
        """Against the reference alone, on one level."""
        points = self._points(samples)
        mosaic = self._reference_mosaic(points)
        for _ in range(PAIRWISE):
            equations = self._equations(points, self._place(points), mosaic, ALIASED)
            if self._step(equations, hold_reference=True) < COARSE_STEP:
                break
        return self._equations(points, self._place(points), mosaic, ALIASED)

    def _reference_mosaic(self, points: Points) -> Mosaic:
        own = points.frame(self.reference)
        place = self.motion.place(own, np.zeros((1, 3)))
        grid = Grid.over(place, own.shape, density=1.0)
        sums = Sums(grid, own.values.shape[1])
        sums.add(own, place)
        return sums.solve(smoothing=0.3, sweeps=8)

    def _refine_jointly(self, points: Points, coarser: Mosaic | None) -> Mosaic:
        """Against the mosaic of all frames, until the finer level can go on."""
        place = self._place(points)
        grid = Grid.over(place, points.shape, DENSITY)
        start = None if coarser is None else resampled(coarser, grid, factor=0.5)
        sums = Sums(grid, points.values.shape[1])
        for _ in range(COARSE):
            mosaic, _, moved = self._joint_step(points, place, sums, start)
            if moved < ENOUGH:
                break
            place, start = self._place(points), mosaic.values
            sums.clear(grid)
        return mosaic

    def _refine_staggered(self, points: Points, coarser: Mosaic | None) -> Equations:
        """Against mosaics on two grids by turns, half a node apart; the result is the mean of the last two.

        Where a frame's pixels lie between the nodes biases its displacement by about a hundredth of a pixel,
        the reference's too, which then is in all others. Half a node on the bias has mostly the other sign.
        """
        place = self._place(points)
        grid = Grid.over(place, points.shape, DENSITY)
        start = None if coarser is None else resampled(coarser, grid, factor=0.5)
        sums = Sums(grid, points.values.shape[1])
        most, enough = (BENT_FINE, BENT_STEP) if points.bent else (FINE, STEP)
        before = self.parameters
        for step in range(most):
            earlier, before = before, self.parameters
            mosaic, equations, moved = self._joint_step(points, place, sums, start)
            if points.bent:  # judged on the same grid: the other one's bias is longer than the last steps
                moved = self._apart(earlier)
            if step > 0 and moved < enough:
                break
            place, grid = self._place(points), grid.staggered(step)
            start = resampled(mosaic, grid, factor=1.0)
            sums.clear(grid)
        self.parameters = (before + self.parameters) / 2
        return equations

    def _joint_step(
        self, points: Points, place: Place, sums: Sums, start: Image | None
    ) -> tuple[Mosaic, Equations, float]:
        sums.add(points, place)
        mosaic = sums.solve(smoothing=SMOOTHING, sweeps=COLD if start is None else SWEEPS, start=start)
        if points.bent:
            misfit = Misfit(sums.grid.size)
            misfit.add(points, place, mosaic)
            mosaic = replace(mosaic, misfit=misfit.image())
        equations = self._equations(points, place, mosaic, POSITION_ERROR)
        return mosaic, equations, self._step(equations, hold_reference=False)

    def _points(self, samples: Samples, blocks: Mask | None = None) -> Points:
        base = self.motion.base(samples)
        if blocks is None:
            return Points.of(samples, base, self.active)
        return Points.within(samples, base, blocks)

    def _equations(self, points: Points, place: Place, mosaic: Mosaic, position_error: float) -> Equations:
        return normal_equations(points, place, mosaic, self.motion, position_error)

    def _place(self, points: Points) -> Place:
        return self.motion.place(points, self.parameters)

    def _step(self, equations: Equations, hold_reference: bool) -> float:
        """Move every frame; return the largest step in pixels."""
        unit = self.motion.unit()
        stiffness = 1 / ((2.0 if self.guided else 5.0) * unit) ** 2
        steps, self.covariance = solve_steps(equations, self.guess - self.parameters, stiffness, unit)
        limit = 2.0 ** (len(self.levels) - 1) * unit
        relaxation = BENT_RELAXATION if self.levels[0].bent else RELAXATION
        steps = np.clip(steps if hold_reference else relaxation * steps, -limit, limit)
        steps[list(self.rejected)] = 0
        if hold_reference:
            steps[self.reference] = 0
        moved = self.motion.moved(self.parameters, steps)
        before, self.parameters = self.parameters, self.motion.relative(moved, self.reference)
        return self._apart(before)

    def _apart(self, before: Float) -> float:
        """The largest way from where the frames were before, pixels."""
        return float(np.abs((self.parameters - before) / self.motion.unit())[self.active].max())

    def _misfits(self, equations: Equations, most: float = STANDS_OUT) -> dict[int, str]:
        others = self.active
        others[self.reference] = False
        return misfits(equations, others, most)

    def _reject(self, found: dict[int, str]) -> None:
        self.rejected |= found
        if not np.any(np.delete(self.active, self.reference)):
            reasons = "; ".join(f"frame {k} {why}" for k, why in sorted(self.rejected.items()))
            raise RegistrationError(f"no frame could be aligned with frame {self.reference}: {reasons}")
