"""One burst in, one fused map out: what the worker does, and `lidarboost fuse` too."""

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.frame import Frame
from drivers.poses import relative_rotations
from service.config.sections import FusionSection
from service.messages.burst import Burst
from service.messages.report import BurstReport, Phases
from service.planning.plan import coverage
from solver import Footprint, FusionWarning, fuse
from solver.geometry import depth_from_distance, fused_intrinsics
from solver.result import Fused, Progress


@dataclass(frozen=True, slots=True)
class FusedBurst:
    """A fused map and where it belongs.

    Attributes:
        frame: the reference frame: its time and angles are the map's.
        calibration: of the camera (one frame).
        distance: (βH, βW) float32, radial metres, NaN = unknown.
        depth: (βH, βW) float32, Z in metres.
        deviation: (βH, βW) float32, one standard deviation of the distance, metres.
        amplitude: (βH, βW) float32, counts per second of integration time, or None.
        intrinsics: (3, 3) camera matrix of the map, pixels; the distortion is the calibration's.
        report: how it went.
    """

    frame: Frame
    calibration: Calibration
    distance: NDArray[np.float32]
    depth: NDArray[np.float32]
    deviation: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None
    intrinsics: NDArray[np.float64]
    report: BurstReport


def fuse_burst(burst: Burst, settings: FusionSection, progress: Progress | None = None) -> FusedBurst:
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
    noise = calibration.noise
    with warnings.catch_warnings():
        # The report says so (`converged`); in a worker nobody would see the warning.
        warnings.simplefilter("ignore", FusionWarning)
        fused = fuse(
            distance,
            amplitude,
            options=replace(settings.options(), footprint=_footprint(calibration)),
            rotations=None if settings.register_poses else turns,
            initial=turns if settings.register_poses else None,
            intrinsics=calibration.intrinsics.matrix,
            distortion=calibration.distortion or None,
            ambiguity_range=reference.ambiguity_range,
            noise=None if noise is None else noise.for_signal(reference.integration_time),
            progress=progress,
        )
    intrinsics = fused_intrinsics(calibration.intrinsics.matrix, settings.upsampling)
    depth = depth_from_distance(fused.distance, intrinsics, calibration.distortion or None)
    report = _report(burst, fused, settings.upsampling, time.perf_counter() - began)
    return FusedBurst(
        reference, calibration, fused.distance, depth, fused.deviation, fused.amplitude, intrinsics, report
    )


def _footprint(calibration: Calibration) -> Footprint:
    known = calibration.footprint
    return Footprint(side=known.fill_factor, blur=known.blur)


def stack(
    frames: Sequence[Frame], calibration: Calibration
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Corrected distances in metres, NaN where there is none, and linear amplitudes; (N, H, W) float32."""
    distance = np.stack([calibration.correct(f.distance, f.ambiguity_range) for f in frames])
    # Where gray mode hides the amplitude there is no distance either: the sample is not used at all.
    amplitude = np.nan_to_num(np.stack([f.signal for f in frames]), nan=0.0)
    return distance, amplitude


def _report(burst: Burst, fused: Fused, upsampling: int, seconds: float) -> BurstReport:
    known = np.isfinite(fused.distance)
    spread = fused.deviation[known]
    turns = fused.rotations
    used = list(fused.report.used)
    return BurstReport(
        burst=burst.id,
        timestamp=burst.reference.timestamp,
        frames=len(burst.frames),
        missing=burst.missing,
        sequence=tuple(f.sequence for f in burst.frames),
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
        coverage=coverage(fused.shifts[used], upsampling),
        used=tuple(used),
        rejected=fused.report.rejected,
        contradicted=fused.report.contradicted,
        shifts=tuple((float(dy), float(dx)) for dy, dx in fused.shifts),
        rotations=None if turns is None else tuple((float(x), float(y), float(z)) for x, y, z in turns),
        seconds=Phases(
            registration=fused.report.seconds.registration, solve=fused.report.seconds.solve, total=seconds
        ),
    )
