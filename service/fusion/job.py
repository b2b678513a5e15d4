"""What is given to an executor and its process, and what comes back."""

import time
from dataclasses import dataclass, field

from drivers.calibration import Calibration
from drivers.frame import Frame
from service.config.sections import FusionSection
from service.messages.burst import Burst
from service.messages.map import FusedMap


@dataclass(frozen=True, slots=True)
class BurstJob:
    """Fuse a burst; one whose map somebody waits for is never dropped."""

    burst: Burst
    settings: FusionSection
    awaited: bool = False

    @property
    def number(self) -> int:
        """Of the burst."""
        return self.burst.id

    @property
    def completed(self) -> float:
        """When the last exposure had ended, `time.monotonic()`."""
        return self.burst.completed


@dataclass(frozen=True, slots=True)
class FrameJob:
    """Push a frame into a stream's window and fuse that.

    Attributes:
        frame: the newest.
        calibration: of the camera.
        settings: how to fuse; the same for the whole stream.
        window: frames that are fused together.
        stream: which stream; another number begins one anew.
        number: of the frame in its stream, from 0.
        completed: when its exposure had ended, `time.monotonic()`.
    """

    frame: Frame
    calibration: Calibration
    settings: FusionSection
    window: int
    stream: int
    number: int
    completed: float = field(default_factory=time.monotonic, compare=False)


Job = BurstJob | FrameJob


@dataclass(frozen=True, slots=True)
class WarmUp:
    """Have the kernels ready that these settings need, and those of a stream of that window."""

    settings: FusionSection
    window: int | None = None


@dataclass(frozen=True, slots=True)
class Ready:
    """They are, after so many seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Compiling:
    """How many kernels were compiled so far, and of how many, none of which lay on the disk."""

    kernels: int
    total: int


@dataclass(frozen=True, slots=True)
class Iterating:
    """How far the solver is with the job at work; what is not known on the way is None."""

    iteration: int
    objective: float | None
    gap: float | None


@dataclass(frozen=True, slots=True)
class Failure:
    """A job that could not be done, and why."""

    reason: str


Answer = FusedMap | Ready | Failure
