"""A stream: frame after frame into a window, whose map follows."""

import time
import warnings
from dataclasses import replace

from drivers.frame import Frame
from drivers.poses import relative_rotations
from service.fusion.fuse import corrected, footprint_of, map_of, noise_of
from service.fusion.job import FrameJob
from service.messages.map import FusedMap
from solver import FusionWarning, SlidingFusion

_MOST_ITERATIONS = 120
"""A late map of a stream is worth less than one that is not quite converged; the next goes on from there.
As many as `phasor`'s fixed rounds."""


class Stream:
    """The window of one stream.

    Args:
        job: of its first frame.
    """

    def __init__(self, job: FrameJob) -> None:
        calibration, settings = job.calibration, job.settings
        self._settings = settings
        options = settings.options()
        self._fusion = SlidingFusion(
            replace(
                options,
                footprint=footprint_of(calibration),
                max_iterations=min(options.max_iterations, _MOST_ITERATIONS),
            ),
            window=job.window,
            ambiguity_range=job.frame.ambiguity_range,
            intrinsics=calibration.intrinsics.matrix,
            distortion=calibration.distortion or None,
            noise=noise_of(calibration, job.frame),
        )
        self._first = self._grid = job.frame
        self._frames: dict[int, Frame] = {}
        # A process that was started again knows no frame before this one.
        anew = f"the stream began anew at frame {job.number}: the fusion was started again"
        self._notes: tuple[str, ...] = (anew,) if job.number else ()

    def push(self, job: FrameJob) -> FusedMap:
        """The map of the window with this frame; raises `FusionError` where it cannot be fused."""
        began = time.perf_counter()
        frame, calibration = job.frame, job.calibration
        places = [(self._first.pan, self._first.tilt), (frame.pan, frame.tilt)]
        turn = relative_rotations(places, calibration.mount)[1]
        distance, amplitude = corrected(frame, calibration)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FusionWarning)  # the report says so
            if self._settings.register_poses:
                fused = self._fusion.push(distance, amplitude, initial=turn)
            else:
                fused = self._fusion.push(distance, amplitude, rotation=turn)
        used = fused.report.used
        self._frames = {k: (self._frames | {used[-1]: frame})[k] for k in used}
        if fused.report.notes:  # the grid is this frame's: it moved, or the stream started over
            self._grid = frame
        notes, self._notes = self._notes + fused.report.notes, ()
        return map_of(
            fused,
            number=job.number,
            frames=tuple(self._frames.values()),
            used=range(len(used)),
            reference=replace(self._grid, timestamp=frame.timestamp, sequence=frame.sequence),
            calibration=calibration,
            upsampling=self._settings.upsampling,
            seconds=time.perf_counter() - began,
            notes=notes,
            registered=self._settings.register_poses,
        )
