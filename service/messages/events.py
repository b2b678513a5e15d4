"""What happens in a running service: the values that the daemon hands to its sinks."""

import logging
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from threading import RLock
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, Mount
from drivers.frame import Frame
from drivers.recording import RecordingHead
from service.messages.burst import Burst
from service.messages.map import FusedMap
from service.messages.progress import ScanProgress, SolverProgress
from service.messages.replay import ReplayState
from service.messages.status import State, Status

T = TypeVar("T")


class _Derived:
    """What was made of an event so far."""

    def __init__(self) -> None:
        self.lock = RLock()
        self.values: dict[Hashable, Any] = {}


@dataclass(frozen=True, eq=False)
class Event:
    """Something that happened; equal to itself only.

    Attributes:
        lasting: a sink that begins later is told the latest one first.
        patient: in a lossless run whoever emits it waits for a full queue; what sinks may cause themselves
            (a log record) never does, or a sink would wait for itself.
    """

    lasting: ClassVar[bool] = False
    patient: ClassVar[bool] = True
    derived: _Derived = field(default_factory=_Derived, init=False, repr=False)

    @property
    def size(self) -> int:
        """Bytes that it holds in a queue, about."""
        return 0

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` returns, made by the first who asks and kept for the others."""
        with self.derived.lock:
            if key not in self.derived.values:
                self.derived.values[key] = make()
            value: T = self.derived.values[key]
            return value


@dataclass(frozen=True, eq=False)
class DevicesOpened(Event):
    """Camera and stage are open, or a recording that stands for them is.

    Attributes:
        model, source: what camera, and whether it is a device, a replay or a simulation.
        calibration: in force.
        frames: how many are to come; None = no end is in sight.
        timestamp: ns since the epoch.
    """

    model: str
    source: str
    calibration: Calibration
    frames: int | None
    timestamp: int
    lasting: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class FrameCaptured(Event):
    """A frame that belongs to a burst or a stream was exposed; `mount` tells where the camera looked."""

    frame: Frame
    mount: Mount

    @property
    def size(self) -> int:
        return self.frame.counts.nbytes + (0 if self.frame.amplitude is None else self.frame.amplitude.nbytes)


@dataclass(frozen=True, eq=False)
class ScanProgressed(Event):
    """Another pose of a burst was captured, or its map is there."""

    progress: ScanProgress
    patient: ClassVar[bool] = False


@dataclass(frozen=True, eq=False)
class BurstCaptured(Event):
    """A burst is complete; it is the `number`-th (from 1)."""

    burst: Burst
    number: int


@dataclass(frozen=True, eq=False)
class MapFused(Event):
    """A map is fused; `truth` (βH, βW) is the true distance in metres where it is known."""

    map: FusedMap
    truth: NDArray[np.float32] | None

    @property
    def size(self) -> int:
        return self.map.size


@dataclass(frozen=True, eq=False)
class SolverAdvanced(Event):
    """The solver tells how far it is, some times a second."""

    progress: SolverProgress
    patient: ClassVar[bool] = False


@dataclass(frozen=True, eq=False)
class FusionFailed(Event):
    """The burst, or the stream's frame, of that number could not be fused."""

    number: int
    reason: str


@dataclass(frozen=True, eq=False)
class StateChanged(Event):
    """The service is in another state, or in the same for another reason."""

    state: State
    reason: str
    lasting: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class StatusTold(Event):
    """The status, once a second and after a change of state."""

    status: Status
    patient: ClassVar[bool] = False


@dataclass(frozen=True, eq=False)
class ReplayTold(Event):
    """Where a replay is."""

    replay: ReplayState
    patient: ClassVar[bool] = False


@dataclass(frozen=True, eq=False)
class Logged(Event):
    """A record of the service's log."""

    record: logging.LogRecord
    patient: ClassVar[bool] = False


@dataclass(frozen=True, eq=False)
class Commanded(Event):
    """Somebody had something done: who, when (ns since the epoch), by which command, with which arguments."""

    who: str
    timestamp: int
    command: str
    arguments: dict[str, Any]


@dataclass(frozen=True, eq=False)
class HeadChanged(Event):
    """What a recording begins with is another now; comes before `DevicesOpened`."""

    head: RecordingHead
    lasting: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class Delivery(Event):
    """An answer that goes out behind everything that was published before it."""

    deliver: Callable[[], None]
