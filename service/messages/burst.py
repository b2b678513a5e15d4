"""The frames that become one map."""

import time
from dataclasses import dataclass, field

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
        RecordingError: no frame, frames of another shape than the calibration's, or of different ranges.
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
                    f"burst {self.id} mixes ambiguity ranges of {self.frames[0].ambiguity_range:g} m and "
                    f"{frame.ambiguity_range:g} m; expected one modulation frequency in a burst"
                )

    @property
    def reference(self) -> Frame:
        """The frame that the map is aligned with."""
        return self.frames[0]

    @property
    def missing(self) -> int:
        """Frames that the plan has, but the burst has not."""
        return max(0, self.expected - len(self.frames))


def check_frame(frame: Frame, calibration: Calibration) -> None:
    """Raise `RecordingError` where a frame is not of its calibration's size."""
    if frame.shape != calibration.shape:
        raise RecordingError(
            f"frame {frame.sequence} has {frame.shape[0]} × {frame.shape[1]} pixels; its calibration "
            f"is for {calibration.height} × {calibration.width}: use its own"
        )
