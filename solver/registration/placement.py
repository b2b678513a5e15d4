"""Where all frames look, refined by hierarchical Lucas–Kanade against one of them or the mosaic of all."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.registration.equations import POSITION_ERROR, Equations, normal_equations
from solver.registration.grid import Grid, Place
from solver.registration.misfit import Misfit
from solver.registration.mosaic import Mosaic, resampled
from solver.registration.motion import Motion
from solver.registration.point_samples import Points
from solver.registration.samples import Samples
from solver.registration.steepness import finer_blocks, steep_blocks
from solver.registration.steps import solve_steps
from solver.registration.sums import COLD, Sums

Float = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

STEP = 0.03  # pixels; the next step would be a fifth of it
RELAXATION = 1.2  # a step against the common mosaic falls short, as each frame is part of it
COARSE_STEP = 0.2  # pixels; the finer level goes on
ALIASED = 0.2  # pixels; position error of a mosaic of one frame, whose edges alias
DENSITY = 1.83  # nodes per pixel; two is the Nyquist limit of the footprint's first zero, 1.6 blurs
PAIRWISE, COARSE, FINE = 4, 4, 4  # steps at most
BENT_RELAXATION, BENT_FINE, BENT_STEP = 1.4, 6, 0.02  # where edges count for less, steps fall shorter
ENOUGH = 0.5  # pixels
SMOOTHING = 3.0  # λ; a tenth lets noise into the mosaic and biases high noise, ten times blurs it
ASIDE = 0.88  # of the residual a pixel aside: most frames of the scene have less, others 0.9 or more
MOST = 3.0  # deviations; frames of the scene have up to 2.8, noise on its print 3.1
SWEEPS = 2  # per Gauss–Newton step; six times as many change nothing


class Placement:
    """Parameters (N, 3) of the motion and their covariance (N, 3, 3), and which frames are out.

    Attributes:
        levels: the frames, full resolution first.
        reference: number of the frame at rest.
        guess: (N, 3) parameters that are held to, more where `guided` says that they were given.
        rejected: reason by frame number.
    """

    def __init__(
        self, levels: list[Samples], motion: Motion, reference: int, guess: Float, guided: bool
    ) -> None:
        self.levels = levels
        self.motion = motion
        self.reference = reference
        self.parameters = motion.relative(guess, reference)
        self.guess = self.parameters
        self.guided = guided
        self.rejected: dict[int, str] = {}
        self.covariance = np.zeros((len(guess), 3, 3))

    @property
    def count(self) -> int:
        return len(self.parameters)

    @property
    def active(self) -> Mask:
        keep = np.ones(self.count, dtype=bool)
        keep[list(self.rejected)] = False
        return keep

    def refine_pairwise(self, samples: Samples) -> Equations:
        """Refine each frame against the reference alone, on one level."""
        points = self._points(samples)
        mosaic = self._reference_mosaic(points)
        for _ in range(PAIRWISE):
            equations = self._equations(points, self._place(points), mosaic, ALIASED)
            if self._step(equations, hold_reference=True) < COARSE_STEP:
                break
        return self._equations(points, self._place(points), mosaic, ALIASED)

    def refine_together(self) -> Equations:
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

    def in_place(self, suspects: list[int]) -> list[int]:
        """Those of some frames that resemble the others where they are, and less so a pixel aside.

        Where edges are hard and noise is little, a mosaic follows between the pixels of a few frames less
        well than noise allows. What shows something else resembles it nowhere.
        """
        samples, asked = self.levels[0], np.zeros(self.count, dtype=bool)
        asked[suspects] = True
        base = self.motion.base(samples)
        others, own = Points.of(samples, base, self.active & ~asked), Points.of(samples, base, asked)
        place = self._place(others)
        sums = Sums(Grid.over(place, others.shape, DENSITY), others.values.shape[1])
        sums.add(others, place)
        mosaic = sums.solve(smoothing=SMOOTHING, sweeps=COLD)
        misfits = []
        for aside in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            moved = self.parameters + np.array([*aside, 0]) * self.motion.unit()
            equations = self._equations(own, self.motion.place(own, moved), mosaic, POSITION_ERROR)
            misfits.append(equations.misfit)
        here, beside = misfits[0], np.mean(misfits[1:], axis=0)
        fits = (here < ASIDE * beside) & (here < MOST)
        return [k for k in suspects if fits[k]]

    def apart(self, before: Float) -> float:
        """The largest way from where the frames were before, pixels."""
        return float(np.abs((self.parameters - before) / self.motion.unit())[self.active].max())

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
                moved = self.apart(earlier)
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
        return self.apart(before)
