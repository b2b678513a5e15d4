"""Hierarchical Lucas–Kanade, first against the reference, then all frames against their mosaic."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError, RegistrationError
from solver.geometry import rotations_to_shifts, shifts_to_rotations
from solver.registration.gauss_newton import POSITION_ERROR, Equations, normal_equations, solve_steps
from solver.registration.mosaic import Grid, Mosaic, build_mosaic, resampled, steep_samples
from solver.registration.motion import Motion, Shift, Turn
from solver.registration.samples import Samples, Source, make_samples, pyramid
from solver.registration.start import search_shifts

Float = NDArray[np.float64]

FEWEST = 0.05  # share of valid pixels under which a frame cannot be placed
OVERLAP = 0.3  # share of a frame's pixels that the other frames must cover
STEP = 0.006  # pixels; the next step would be a third of it
COARSE_STEP = 0.2  # pixels; the finer level goes on
ALIASED = 0.2  # pixels; position error of a mosaic of one frame, whose edges alias
SMOOTHING = 3.0  # λ; a tenth lets noise into the mosaic and biases high noise, ten times blurs it
SWEEPS = 4  # of conjugate gradients per Gauss–Newton step; twelve change nothing
DENSITY = (
    2.118  # nodes per pixel: the footprint's first zero is at one cycle a pixel, the Nyquist limit of two
)
COARSE_STEP = 0.2  # pixels; the finer level goes on
ALIASED = 0.2  # pixels; position error of a mosaic of one frame, whose edges alias
DENSITY = (
    2.118  # nodes per pixel: the footprint's first zero is at one cycle a pixel, the Nyquist limit of two
)


@dataclass(frozen=True, slots=True)
class Registration:
    """Where the frames look.

    Attributes:
        shifts: (N, 2) displacement (dy, dx) in low-resolution pixels of the reference, at the image centre.
        rotations: (N, 3) rotation vectors in radians that take each frame's rays to the reference's, or None
            where displacements were found.
        uncertainty: (N, 2) one standard deviation of the displacement at the image centre, in pixels.
        rejected: reason by frame number for the frames that do not fit; their shifts are no better than the
            first guess.
    """

    shifts: Float
    rotations: Float | None
    uncertainty: Float
    rejected: dict[int, str] = field(default_factory=dict)


def register(
    distance: ArrayLike,
    amplitude: ArrayLike | None = None,
    *,
    intrinsics: ArrayLike | None = None,
    distortion: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    reference: int = 0,
    ambiguity_range: float | None = None,
    source: Source = "auto",
) -> Registration:
    """Find where each frame looks, relative to the frame `reference`.

    A rotation per frame (three parameters) where the camera is calibrated, one displacement otherwise.

    Args:
        distance: (N, H, W), NaN = invalid.
        amplitude: (N, H, W), linear in the received light; weights the samples.
        intrinsics: 3 × 3, in low-resolution pixels.
        distortion: OpenCV coefficients.
        initial: (N, 2) displacements or, with intrinsics, (N, 3) rotation vectors: a first guess only.
        reference: number of the frame at rest.

    Raises:
        FusionInputError: wrong shapes, or NaN in `initial`.
        RegistrationError: the reference has hardly a valid pixel, or no other frame fits it.
    """
    images = np.asarray(distance, dtype=np.float32)
    light = None if amplitude is None else np.asarray(amplitude, dtype=np.float32)
    if images.ndim != 3 or (light is not None and light.shape != images.shape):
        raise FusionInputError(f"distance has shape {images.shape}; expected (N, H, W), amplitude the same")
    count, shape = len(images), (images.shape[1], images.shape[2])
    if not 0 <= reference < count:
        raise FusionInputError(f"reference is {reference}; expected a frame number from 0 to {count - 1}")
    motion: Motion = Shift() if intrinsics is None else Turn.of(intrinsics, distortion)
    guess = _first_guess(initial, motion, count, shape)
    if count == 1:
        return _result(np.zeros((1, 3)), np.zeros((1, 3, 3)), {}, motion, shape, reference)
    work = _Work(
        pyramid(make_samples(images, light, ambiguity_range, source)),
        motion,
        reference,
        guess,
        initial is not None,
        {},
    )
    work.drop_empty()
    work.align_with_reference()
    work.align_together()
    return _result(work.parameters, work.covariance, work.rejected, motion, shape, reference)


def _first_guess(initial: ArrayLike | None, motion: Motion, count: int, shape: tuple[int, int]) -> Float:
    guess = np.zeros((count, 3))
    if initial is None:
        return guess
    given: Float = np.asarray(initial, dtype=np.float64)
    if given.ndim != 2 or len(given) != count or given.shape[1] not in (2, 3):
        raise FusionInputError(f"initial has shape {given.shape}; expected ({count}, 2) or ({count}, 3)")
    if not np.isfinite(given).all():
        raise FusionInputError("initial holds NaN or infinity; expected finite numbers, or None")
    if isinstance(motion, Shift):
        if given.shape[1] == 3:
            raise FusionInputError("initial rotations (N, 3) need the camera's intrinsics")
        guess[:, :2] = given
    elif given.shape[1] == 3:
        guess[:] = given
    else:
        guess[:] = shifts_to_rotations(given, shape, motion.intrinsics, motion.lens)
    return guess


class _Work:
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

    def align_with_reference(self) -> None:
        """Search, then refine each frame against the reference alone; search anew where a guess was wrong."""
        self.parameters = self._searched(self.guided)
        equations = self._refine_pairwise()
        misfits = self._misfits(equations)
        if self.guided and misfits:
            kept = self.parameters
            self.parameters = self._searched(guided=False)
            again = self._refine_pairwise()
            better = np.zeros(self.count, dtype=bool)
            better[list(misfits)] = again.misfit[list(misfits)] < equations.misfit[list(misfits)]
            self.parameters = np.where(better[:, None], self.parameters, kept)
            misfits = {k: why for k, why in misfits.items() if not better[k]}
        self._reject(misfits)

    def align_together(self) -> None:
        """Refine all frames against their common mosaic, coarse to fine; reject what still does not fit."""
        for _ in range(3):  # rejecting a frame changes the mosaic, so the rest is refined again
            samples, coarser = self.levels[0], None
            if len(self.levels) > 1:
                _, coarser = self._refine_jointly(self.levels[1], most=1)
                near = self._positions(samples) * np.float32(0.5) - np.float32(0.25)  # on the pooled grid
                samples = replace(samples, weights=samples.weights * steep_samples(coarser, near))
            equations, _ = self._refine_jointly(samples, most=8, coarser=coarser)
            misfits = self._misfits(equations)
            if not misfits:
                return
            self._reject(misfits)

    def _searched(self, guided: bool) -> Float:
        coarse = self.levels[-1]
        height, width = coarse.shape
        shape = self.levels[0].shape
        turn = self.motion if isinstance(self.motion, Turn) else None
        if turn is None:
            centre = self.guess[:, :2]
        else:
            centre = rotations_to_shifts(self.guess, shape, turn.intrinsics, turn.lens)
        if not guided:
            centre = np.zeros_like(centre)
        radius = (1, 1) if guided else (max(1, height // 4), max(1, width // 4))
        found = search_shifts(coarse, self.reference, centre, radius)
        if turn is None:
            return np.column_stack([found, np.zeros(self.count)])
        moved = (found != centre).any(axis=1)
        start = self.guess.copy()
        start[moved] = shifts_to_rotations(found[moved], shape, turn.intrinsics, turn.lens)
        return start

    def _refine_pairwise(self) -> Equations:
        """Against the reference alone, on the pooled levels."""
        for samples in self.levels[:0:-1] or self.levels:
            mosaic = self._reference_mosaic(samples)
            for _ in range(4):
                equations = self._equations(samples, mosaic, ALIASED)
                if self._step(equations, hold_reference=True) < COARSE_STEP:
                    break
        return self._equations(samples, mosaic, ALIASED)

    def _reference_mosaic(self, samples: Samples) -> Mosaic:
        one = slice(self.reference, self.reference + 1)
        positions = self.motion.positions(np.zeros((1, 3)), samples.shape, samples.level)
        grid = Grid.over(positions, density=1)
        return build_mosaic(
            samples.values[:, one], samples.weights[one], positions, grid, smoothing=0.3, sweeps=8
        )

    def _refine_jointly(
        self, samples: Samples, most: int, coarser: Mosaic | None = None
    ) -> tuple[Equations, Mosaic]:
        """Against the mosaic of all frames that are not rejected."""
        weights = samples.weights * self.active[:, None, None]
        positions = self._positions(samples)
        grid = Grid.over(positions[self.active], DENSITY)
        start = None if coarser is None else resampled(coarser, grid, factor=0.5)
        while True:
            mosaic = build_mosaic(
                samples.values, weights, positions, grid, smoothing=SMOOTHING, sweeps=SWEEPS, start=start
            )
            equations = normal_equations(samples, positions, mosaic, self.motion, POSITION_ERROR)
            most -= 1
            if self._step(equations, hold_reference=False) < STEP or most == 0:
                return equations, mosaic
            positions, start = self._positions(samples), mosaic.values

    def _equations(self, samples: Samples, mosaic: Mosaic, position_error: float) -> Equations:
        return normal_equations(samples, self._positions(samples), mosaic, self.motion, position_error)

    def _positions(self, samples: Samples) -> NDArray[np.float32]:
        return self.motion.positions(self.parameters, samples.shape, samples.level)

    def _step(self, equations: Equations, hold_reference: bool) -> float:
        """Move every frame; return the largest step in pixels."""
        unit = self.motion.unit()
        stiffness = 1 / ((2.0 if self.guided else 5.0) * unit) ** 2
        steps, self.covariance = solve_steps(equations, self.guess - self.parameters, stiffness)
        limit = 2.0 ** (len(self.levels) - 1) * unit
        steps = np.clip(steps, -limit, limit)
        steps[list(self.rejected)] = 0
        if hold_reference:
            steps[self.reference] = 0
        moved = self.motion.moved(self.parameters, steps)
        before, self.parameters = self.parameters, self.motion.relative(moved, self.reference)
        return float(np.abs((self.parameters - before) / unit)[self.active].max())

    def _misfits(self, equations: Equations) -> dict[int, str]:
        """Reason by number for the frames that stand out."""
        found: dict[int, str] = {}
        others = self.active
        others[self.reference] = False
        usual = float(np.median(equations.misfit[others])) if others.any() else 0.0
        for k in np.flatnonzero(others):
            overlap, misfit = equations.overlap[k], equations.misfit[k]
            if overlap < OVERLAP:
                found[int(k)] = (
                    f"overlaps the other frames by {100 * overlap:.0f} %; {100 * OVERLAP:.0f} % are needed"
                )
            elif misfit > max(1.5, 1.6 * usual) and not misfit < 1.2 * usual:
                found[int(k)] = (
                    f"does not fit the other frames: residual {misfit:.1f} deviations, {usual:.1f} is usual"
                )
        return found

    def _reject(self, found: dict[int, str]) -> None:
        self.rejected |= found
        if not np.any(np.delete(self.active, self.reference)):
            reasons = "; ".join(f"frame {k} {why}" for k, why in sorted(self.rejected.items()))
            raise RegistrationError(f"no frame could be aligned with frame {self.reference}: {reasons}")


def _result(
    parameters: Float,
    covariance: Float,
    rejected: dict[int, str],
    motion: Motion,
    shape: tuple[int, int],
    reference: int,
) -> Registration:
    if isinstance(motion, Turn):
        shifts = rotations_to_shifts(parameters, shape, motion.intrinsics, motion.lens)
        fy, fx = motion.camera(0)[:2]
        variance = np.stack([covariance[:, 0, 0] * fy**2, covariance[:, 1, 1] * fx**2], axis=-1)
    else:
        shifts = parameters[:, :2].copy()
        variance = np.stack([covariance[:, 0, 0], covariance[:, 1, 1]], axis=-1)
    # A frame's displacement is a difference: the reference's own error is part of it.
    uncertainty = np.sqrt(variance + variance[reference])
    uncertainty[reference] = 0
    rotations = parameters.copy() if isinstance(motion, Turn) else None
    return Registration(shifts, rotations, uncertainty, rejected)
