"""The one entrance: frames in, fused map out."""

import time
import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver import checks
from solver import noise as noise_law
from solver.deviation import deviation
from solver.errors import FusionInputError, FusionWarning
from solver.fill import nearest, reach
from solver.methods import load
from solver.options import FusionOptions, Method
from solver.positions import sample_positions
from solver.problem import Problem, Solution
from solver.result import Fused, Progress, Report, Seconds


@dataclass(frozen=True, slots=True)
class Poses:
    """Where every frame looks: (N, 2) shifts or (N, 3) rotations, and the frames that did not fit."""

    shifts: NDArray[np.float64]
    rotations: NDArray[np.float64] | None
    rejected: dict[int, str]


def fuse(
    distance: ArrayLike,
    amplitude: ArrayLike | None = None,
    *,
    options: FusionOptions | None = None,
    shifts: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    intrinsics: ArrayLike | None = None,
    distortion: ArrayLike | None = None,
    ambiguity_range: float | None = None,
    noise: float | None = None,
    guide: ArrayLike | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Fuse N frames of (H, W) into one map of (βH, βW) on the grid of frame 0.

    Args:
        distance: (N, H, W), radial, any unit, NaN = invalid.
        amplitude: (N, H, W), linear in the received light, or None.
        options: what to do; defaults to `FusionOptions()`.
        shifts: (N, 2) exact (dy, dx) in low-resolution pixels; pixel (i, j) of frame k looks where pixel
            (i + dy, j + dx) of frame 0 looks.
        rotations: (N, 3) exact rotation vectors, radians, camera axes, taking frame k's rays to frame 0's;
            needs `intrinsics`.
        initial: (N, 2) or (N, 3), a first guess of the same, from the stage.
        intrinsics: (3, 3) camera matrix in low-resolution pixels: register by rotation.
        distortion: OpenCV's coefficients.
        ambiguity_range: where distances wrap, in the unit of distance.
        noise: c in σ(distance) = c / amplitude (σ itself without amplitude); None = estimated.
        guide: (βH, βW) intensity image for `mrf`.
        progress: called with (iteration, objective, gap) now and then; raising in it cancels.

    Raises:
        FusionInputError: an argument cannot be used; the message says why.
        RegistrationError: no frame could be aligned with frame 0.

    Warns:
        FusionWarning: `max_iterations` was reached before the tolerance.
    """
    options = options or FusionOptions()
    checks.check_options(options)
    frames = checks.check_frames(distance)
    light = checks.check_amplitude(amplitude, frames.shape)
    matrix, lens = checks.check_intrinsics(intrinsics, distortion)
    span = checks.check_scalar("ambiguity_range", ambiguity_range)
    given = checks.check_scalar("noise", noise)
    factor = int(options.upsampling)
    image = checks.check_guide(guide, (frames.shape[1] * factor, frames.shape[2] * factor))
    options = replace(options, method=_resolve(options.method, light, span))

    begin = time.perf_counter()
    poses = _align(frames, light, span, shifts, rotations, initial, matrix, lens)
    used = [k for k in range(len(frames)) if k not in poses.rejected]
    registered = time.perf_counter()

    problem = _pose(frames, light, poses, used, matrix, lens, span, given, image, options)
    solution = load(options.method)(problem, progress=progress)
    fused, spread = finish(problem, solution)
    seconds = Seconds(registered - begin, time.perf_counter() - registered)
    if not solution.converged:
        warnings.warn(
            f"{options.method} stopped after {solution.iterations} iterations (max_iterations) before the "
            f"objective settled to {options.tolerance:g}",
            FusionWarning,
            stacklevel=2,
        )
    report = Report(
        method=options.method,
        regularization=solution.regularization,
        iterations=solution.iterations,
        objective=solution.objective,
        gap=solution.gap,
        converged=solution.converged,
        seconds=seconds,
        noise=problem.noise,
        used=tuple(used),
        rejected=poses.rejected,
    )
    return Fused(fused, spread, solution.amplitude, poses.shifts, poses.rotations, report)


def finish(problem: Problem, solution: Solution) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(distance, deviation), filled up to `fill` low-resolution pixels from the nearest used sample."""
    factor = problem.options.upsampling
    seen = _seen(problem)
    away = reach(seen) / np.float32(factor)
    known = np.isfinite(solution.distance)
    distance = nearest(solution.distance, known) if not known.all() else solution.distance
    spread = deviation(problem, away)
    beyond = away > problem.options.fill
    distance = np.where(beyond, np.float32(np.nan), distance)
    return distance, np.where(beyond, np.float32(np.nan), spread)


def _seen(problem: Problem) -> NDArray[np.bool_]:
    factor = problem.options.upsampling
    rows, columns = problem.fused_shape
    valid = np.isfinite(problem.distance)
    cell = np.floor((problem.positions[valid] + 0.5) * factor).astype(np.int64)
    inside = (cell >= 0).all(-1) & (cell[:, 0] < rows) & (cell[:, 1] < columns)
    seen = np.zeros((rows, columns), np.bool_)
    seen[cell[inside, 0], cell[inside, 1]] = True
    if not seen.any():
        raise FusionInputError(
            "no valid pixel falls on the grid of frame 0; expected shifts smaller than the image"
        )
    return seen


def _resolve(method: Method, amplitude: NDArray[np.float32] | None, ambiguity_range: float | None) -> Method:
    if method == "auto":
        return "phasor" if amplitude is not None and ambiguity_range is not None else "area"
    if method == "phasor" and (amplitude is None or ambiguity_range is None):
        raise FusionInputError(
            "method 'phasor' needs amplitude and ambiguity_range; give both, or use 'area'"
        )
    return method


def _align(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    ambiguity_range: float | None,
    shifts: ArrayLike | None,
    rotations: ArrayLike | None,
    initial: ArrayLike | None,
    intrinsics: NDArray[np.float64] | None,
    distortion: NDArray[np.float64] | None,
) -> Poses:
    count = len(distance)
    if shifts is not None and rotations is not None:
        raise FusionInputError("shifts and rotations are both given; expected at most one of them")
    exact = checks.check_vectors("shifts", shifts, count, (2,))
    turns = checks.check_vectors("rotations", rotations, count, (3,))
    guess = checks.check_vectors("initial", initial, count, (2, 3))
    if turns is not None and intrinsics is None:
        raise FusionInputError("rotations need intrinsics; give the 3 × 3 camera matrix too")
    if guess is not None and guess.shape[1] == 3 and intrinsics is None:
        raise FusionInputError("initial holds rotations, which need intrinsics; give them or (N, 2) shifts")
    empty = {k: "no valid pixel" for k in range(count) if np.isnan(distance[k]).all()}
    if exact is not None:
        return Poses(exact, None, empty)
    if turns is not None:
        return Poses(_central_shifts(distance.shape, turns, intrinsics, distortion), turns, empty)
    if count == 1:
        return Poses(np.zeros((1, 2)), None if intrinsics is None else np.zeros((1, 3)), empty)
    from solver.registration import register

    found = register(
        distance,
        amplitude,
        intrinsics=intrinsics,
        distortion=distortion,
        initial=guess,
        ambiguity_range=ambiguity_range,
    )
    return Poses(found.shifts, found.rotations, {**found.rejected, **empty})


def _central_shifts(
    shape: tuple[int, int, int],
    rotations: NDArray[np.float64],
    intrinsics: NDArray[np.float64] | None,
    distortion: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """(N, 2): how far rotations move the image centre, the mean over the one to four pixels around it."""
    rows, columns = shape[1:]
    positions = sample_positions(shape, rotations=rotations, intrinsics=intrinsics, distortion=distortion)
    window = (slice((rows - 1) // 2, rows // 2 + 1), slice((columns - 1) // 2, columns // 2 + 1))
    middle = positions[:, window[0], window[1]].mean(axis=(1, 2), dtype=np.float64)
    return np.asarray(middle - [(rows - 1) / 2, (columns - 1) / 2])


def _pose(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32] | None,
    poses: Poses,
    used: list[int],
    intrinsics: NDArray[np.float64] | None,
    distortion: NDArray[np.float64] | None,
    ambiguity_range: float | None,
    noise: float | None,
    guide: NDArray[np.float32] | None,
    options: FusionOptions,
) -> Problem:
    """The problem for a method: the used frames, their positions and noise, dark samples left out."""
    distance = distance[used]
    amplitude = None if amplitude is None else amplitude[used]
    if noise is None:
        noise = noise_law.estimate(distance, amplitude)
    sigma = noise_law.deviations(distance, amplitude, noise)
    if amplitude is not None:
        distance = _lit(distance, amplitude, noise, ambiguity_range, options)
    if poses.rotations is None:
        positions = sample_positions(distance.shape, shifts=poses.shifts[used])
    else:
        positions = sample_positions(
            distance.shape, rotations=poses.rotations[used], intrinsics=intrinsics, distortion=distortion
        )
    lost = np.isnan(positions[..., 0])
    if lost.any():
        distance = np.where(lost, np.float32(np.nan), distance)
    return Problem(
        distance,
        amplitude,
        positions,
        sigma,
        noise,
        ambiguity_range,
        guide,
        options,
    )


def _lit(
    distance: NDArray[np.float32],
    amplitude: NDArray[np.float32],
    noise: float,
    ambiguity_range: float | None,
    options: FusionOptions,
) -> NDArray[np.float32]:
    """T_k of the paper: NaN where the amplitude is under the threshold. `phasor` weighs samples by itself."""
    threshold = options.amplitude_threshold
    if threshold == "auto":
        if options.method in ("phasor", "area"):
            threshold = 0.0
        else:
            threshold = noise_law.amplitude_threshold(amplitude, noise, ambiguity_range)
    kept = np.where(amplitude >= threshold, distance, np.float32(np.nan))
    if np.isnan(kept).all():
        raise FusionInputError(
            f"every pixel's amplitude is under amplitude_threshold {threshold:g} (highest "
            f"{np.nanmax(amplitude):g}); lower the threshold or expose longer"
        )
    return kept
