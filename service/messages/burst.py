"""The frames that become one map."""

import time
from dataclasses import dataclass, field

import numpy as np

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import Frame


@dataclass(frozen=True, slots=True)
class Burst:
    """Frames of one run through the plan; the first is the reference, on whose grid the map lies.

    Attributes:
        id: number of the burst.
        frames: at least one, all of the calibration's shape.
        calibration: of the camera that took them.
        expected: how many frames the plan has; more than `len(frames)` where some are missing.
        completed: when the last exposure had ended or, where that is not known, the last frame had come;
            `time.monotonic()` of this process.

    Raises:
        RecordingError: no frame, frames of another shape than the calibration's, of different ranges, or of
            which only some have an amplitude.
    """

    id: int
    frames: tuple[Frame, ...]
    calibration: Calibration
    expected: int
    completed: float = field(default_factory=time.monotonic, compare=False)

    def __post_init__(self) -> None:
        if not self.frames:
            raise RecordingError(f"burst {self.id} has no frame; expected {self.expected}")
        for frame in self.frames:
            check_frame(frame, self.calibration)
            if frame.ambiguity_range != self.frames[0].ambiguity_range:
                raise RecordingError(
                    f"burst {self.id} mixes ambiguity ranges of {_metres(self.frames[0].ambiguity_range)} "
                    f"and {_metres(frame.ambiguity_range)}; expected one modulation frequency in a burst"
                )
            if frame.has_amplitude != self.frames[0].has_amplitude:
                raise RecordingError(
                    f"burst {self.id} mixes frames with amplitude and without; expected frames of one camera"
                )

    @property
    def reference(self) -> Frame:
        """The frame that the map is aligned with."""
        return self.frames[0]

    @property
    def missing(self) -> int:
        """Frames that the plan has, but the burst has not."""
        return max(0, self.expected - len(self.frames))


def _metres(reach: float | None) -> str:
    return "none" if reach is None else f"{reach:g} m"


def check_frame(frame: Frame, calibration: Calibration) -> None:
    """Raise `RecordingError` where a frame is not of its calibration's size, or cannot be corrected by it."""
    if frame.shape != calibration.shape:
        raise RecordingError(
            f"frame {frame.sequence} has {frame.shape[0]} × {frame.shape[1]} pixels; its calibration "
            f"is for {calibration.height} × {calibration.width}: use its own"
        )
    if frame.ambiguity_range is None:
        calibration.corrections.error(np.zeros(frame.shape), None)
