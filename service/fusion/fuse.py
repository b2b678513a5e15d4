"""One burst in, one fused map out."""

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.frame import Frame
from drivers.poses import relative_rotations
from service.config.sections import FusionSection
from service.fusion.motion import found_motion
from service.messages.burst import Burst
from service.messages.map import FusedMap
from service.messages.report import BurstReport, Phases
from service.planning.plan import coverage
from solver import Footprint, FusionWarning, fuse
from solver.geometry.points import depth_from_distance, fused_intrinsics
from solver.result import Fused, Progress


def fuse_burst(burst: Burst, settings: FusionSection, progress: Progress | None = None) -> FusedMap:
    """Correct, fuse and convert to depth.

    Args:
        burst: the frames.
        settings: method and its options.
        progress: as for `solver.fuse`.

    Raises:
        FusionError: the frames cannot be fused; says why.
    """
    began = time.perf_counter()
    calibration, reference = burst.calibration, replace(burst.reference)  # without its cached images
    distance, amplitude = stack(burst.frames, calibration)
    turns = relative_rotations([(f.pan, f.tilt) for f in burst.frames], calibration.mount)
    with warnings.catch_warnings():
        # The report says so (`converged`); in a worker nobody would see the warning.
        warnings.simplefilter("ignore", FusionWarning)
        fused = fuse(
            distance,
            amplitude,
            options=replace(settings.options(), footprint=footprint_of(calibration)),
            rotations=None if settings.register_poses else turns,
            initial=turns if settings.register_poses else None,
            intrinsics=calibration.intrinsics.matrix,
            distortion=calibration.distortion or None,
            ambiguity_range=reference.ambiguity_range,
            noise=noise_of(calibration, reference),
            progress=progress,
        )
    return map_of(
        fused,
        number=burst.id,
        frames=burst.frames,
        used=fused.report.used,
        missing=burst.missing,
        reference=reference,
        calibration=calibration,
        upsampling=settings.upsampling,
        seconds=time.perf_counter() - began,
        registered=settings.register_poses,
    )


def map_of(
    fused: Fused,
    *,
    number: int,
    frames: Sequence[Frame],
    used: Sequence[int],
    reference: Frame,
    calibration: Calibration,
    upsampling: int,
    seconds: float,
    missing: int = 0,
    notes: tuple[str, ...] = (),
    registered: bool = False,
) -> FusedMap:
    """What the solver gives, with its depth and its report.

    Args:
        fused: a row of its shifts for each of `frames`.
        number: of the burst, or of the newest frame of a stream.
        used: positions in `frames` of those fused.
        reference: the frame on whose grid the map lies.
        upsampling: β.
        seconds: from the frames to the map.
        missing: frames that the plan has, but the burst has not.
        notes: what else is to be said.
        registered: whether its rotations were found in the frames, and are not what the stage says.
    """
    lens = calibration.distortion or None
    intrinsics = fused_intrinsics(calibration.intrinsics.matrix, upsampling)
    depth = depth_from_distance(fused.distance, intrinsics, lens)
    known = np.isfinite(fused.distance)
    # Every other pixel both ways: neighbours share samples, and a median of all takes long.
    spread, turns = fused.deviation[::2, ::2][known[::2, ::2]], fused.rotations
    motion = None
    if registered and turns is not None:
        motion = found_motion(turns[list(used)], [frames[k] for k in used], calibration)
    report = BurstReport(
        burst=number,
        timestamp=reference.timestamp,
        frames=len(frames),
        missing=missing,
        sequence=tuple(f.sequence for f in frames),
        method=fused.report.method,
        upsampling=upsampling,
        height=fused.distance.shape[0],
        width=fused.distance.shape[1],
        known=float(known.mean()),
        regularization=fused.report.regularization,
        iterations=fused.report.iterations,
        objective=fused.report.objective,
        gap=fused.report.gap,
        converged=fused.report.converged,
        noise=fused.report.noise,
        deviation=float(np.median(spread)) if spread.size else None,
        coverage=coverage(fused.shifts[list(used)], upsampling),
        used=tuple(used),
        rejected=fused.report.rejected,
        contradicted=fused.report.contradicted,
        shifts=tuple((float(dy), float(dx)) for dy, dx in fused.shifts),
        rotations=None if turns is None else tuple((float(x), float(y), float(z)) for x, y, z in turns),
        motion=motion,
        seconds=Phases(
            registration=fused.report.seconds.registration, solve=fused.report.seconds.solve, total=seconds
        ),
        notes=notes,
    )
    return FusedMap(
        frame=reference,
        calibration=calibration,
        distance=fused.distance,
        depth=depth,
        deviation=fused.deviation,
        amplitude=fused.amplitude,
        reason=fused.reason,
        intrinsics=intrinsics,
        report=report,
    )


def footprint_of(calibration: Calibration) -> Footprint:
    """How a pixel gathers light, as the solver takes it."""
    known = calibration.footprint
    return Footprint(side=known.fill_factor, blur=known.blur)


def noise_of(calibration: Calibration, frame: Frame) -> float | None:
    """c in σ(distance) = c / signal; None, to be estimated, where no law is known.

    Nor is there one for a frame without amplitude: the solver would take c for σ itself.
    """
    law = calibration.noise if frame.has_amplitude else None
    return None if law is None else law.for_signal(frame.integration_time)


def stack(
    frames: Sequence[Frame], calibration: Calibration
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Corrected distances in metres, NaN where there is none, and linear amplitudes; (N, H, W) float32."""
    pairs = [corrected(frame, calibration) for frame in frames]
    amplitudes = [amplitude for _, amplitude in pairs if amplitude is not None]
    return np.stack([distance for distance, _ in pairs]), np.stack(amplitudes) if amplitudes else None


def corrected(
    frame: Frame, calibration: Calibration
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Corrected distance in metres, NaN where there is none, and linear amplitude; (H, W) float32.

    None in its place where the camera gives no amplitude.
    """
    distance = calibration.correct(frame.distance, frame.ambiguity_range)
    if frame.signal is None:
        return distance, None
    # Where gray mode hides the amplitude there is no distance either: the sample is not used at all.
    return distance, np.nan_to_num(frame.signal, nan=0.0)
