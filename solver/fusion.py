"""The one entrance: frames in, fused map out."""

import time
import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver import checks
from solver.completion.complete import complete
from solver.errors import FusionInputError, FusionWarning
from solver.geometry.points import rotations_to_shifts
from solver.geometry.positions import sample_positions
from solver.methods import load
from solver.options import FusionOptions, Method
from solver.preparation.farthest import check_units, find_farthest, without
from solver.preparation.prepare import prepare
from solver.preparation.problem import Solution
from solver.result import Fused, Progress, Report, Seconds
from solver.runtime.threads import enough_threads


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
        progress: called with (iteration, objective, gap) now and then, the last two None where they are not
            known on the way; raising in it cancels.

    Raises:
        FusionInputError: an argument cannot be used; the message says why.
        RegistrationError: no frame could be aligned with frame 0.

    Warns:
        FusionWarning: `max_iterations` was reached before the tolerance; or what the frames show repeats, and
            no first guess says where they look.
    """
    options = options or FusionOptions()
    checks.check_options(options)
    frames = checks.check_frames(distance)
    light = checks.check_amplitude(amplitude, frames.shape)
    matrix, lens = checks.check_intrinsics(intrinsics, distortion)
    ambiguity_range = checks.check_scalar("ambiguity_range", ambiguity_range)
    given = checks.check_scalar("noise", noise)
    factor = int(options.upsampling)
    image = checks.check_guide(guide, (frames.shape[1] * factor, frames.shape[2] * factor))
    options = replace(options, method=resolve(options.method, light, ambiguity_range))

    begin = time.perf_counter()
    check_units(frames, ambiguity_range)
    known, _ = without(frames, find_farthest(frames, ambiguity_range))
    poses = _align(known, light, ambiguity_range, shifts, rotations, initial, matrix, lens)
    used = [k for k in range(len(frames)) if k not in poses.rejected]
    registered = time.perf_counter()

    shape = (len(used), *frames.shape[1:])
    with enough_threads(frames[0].size * factor**2):
        if poses.rotations is None:
            positions = sample_positions(shape, shifts=poses.shifts[used])
        else:
            vectors = poses.rotations[used]
            positions = sample_positions(shape, rotations=vectors, intrinsics=matrix, distortion=lens)
        problem = prepare(
            frames[used],
            None if light is None else light[used],
            positions,
            options=options,
            ambiguity_range=ambiguity_range,
            noise=given,
            guide=image,
        )
        solution = load(options.method)(problem, progress=progress)
        fused, deviation, reason = complete(problem, solution)
    seconds = Seconds(registered - begin, time.perf_counter() - registered)
    if not solution.converged:
        warn_unconverged(options, solution, stacklevel=3)
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
        contradicted=problem.contradicted,
    )
    return Fused(fused, deviation, solution.amplitude, poses.shifts, poses.rotations, report, reason)


def warn_unconverged(options: FusionOptions, solution: Solution, stacklevel: int) -> None:
    """Say that `max_iterations` ended the iteration; `stacklevel` as in `warnings.warn`, from here."""
    warnings.warn(
        f"{options.method} stopped after {solution.iterations} iterations (max_iterations) before the "
        f"objective settled to {options.tolerance:g}",
        FusionWarning,
        stacklevel=stacklevel,
    )


def resolve(method: Method, amplitude: NDArray[np.float32] | None, ambiguity_range: float | None) -> Method:
    """The method that `auto` stands for with these data."""
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
    vectors = checks.check_vectors("rotations", rotations, count, (3,))
    guess = checks.check_vectors("initial", initial, count, (2, 3))
    if vectors is not None and intrinsics is None:
        raise FusionInputError("rotations need intrinsics; give the 3 × 3 camera matrix too")
    if guess is not None and guess.shape[1] == 3 and intrinsics is None:
        raise FusionInputError("initial holds rotations, which need intrinsics; give them or (N, 2) shifts")
    empty = {k: "no valid pixel" for k in range(count) if np.isnan(distance[k]).all()}
    if exact is not None:
        return Poses(exact, None, empty)
    if vectors is not None and intrinsics is not None:
        return Poses(rotations_to_shifts(vectors, distance.shape[1:], intrinsics, distortion), vectors, empty)
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
    if found.period is not None and guess is None:
        warnings.warn(
            f"all that the frames show repeats after {found.period:.0f} pixels: they are placed within half "
            "of that; give `initial`, the stage's angles, where they look further away from frame 0",
            FusionWarning,
            stacklevel=3,
        )
    return Poses(found.shifts, found.rotations, {**found.rejected, **empty})
