"""Grabs frames, and counts what happens to them."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import DeviceTimeoutError, OperationError
from drivers.frame import Frame
from service.capture.control import Control
from service.capture.priority import Foremost
from service.capture.rig import Rig

_STALE = 100
"""Stale frames in a row that cannot be what was still in the camera's buffers."""


@dataclass(slots=True)
class CaptureCounts:
    """What happened so far.

    Attributes:
        frames: frames that went into bursts, finished or not.
        stale: frames thrown away because they were exposed before the stage stood still.
        dropped: frames that the camera took and that never arrived (gaps in its numbers).
        faults: frames that failed and were tried again.
        lost: times that a device was lost.
        interrupted: bursts given up and taken again.
        bursts: finished bursts.
        error: the last fault, in words; empty = none, or frames have come since.
    """

    frames: int = 0
    stale: int = 0
    dropped: int = 0
    faults: int = 0
    lost: int = 0
    interrupted: int = 0
    bursts: int = 0
    error: str = ""


class Grabber:
    """Grabs frames, counts what is missing between them, and shows each one it keeps to a listener.

    Attributes:
        timeout: seconds to wait for a frame.
    """

    def __init__(
        self, rig: Rig, timeout: float, control: Control, listener: Callable[[Frame], None] = lambda _: None
    ) -> None:
        self.rig, self.control = rig, control
        self.counts = CaptureCounts()
        self.timeout = timeout
        rig.stage.interrupted = self._interrupted
        self._listener = listener
        self._sequence: int | None = None
        self._held: Frame | None = None
        self._foremost = Foremost()

    def _interrupted(self) -> bool:
        """Asked by a stage that moves, and has a deadline of its own: a sign of life."""
        self.rig.beat()
        return self.control.halted

    def grab(self) -> Frame:
        """The next frame; raises as `Camera.grab`, and `StoppedError` once stopped or cancelled."""
        self.control.check()
        if self._held is not None:
            held, self._held = self._held, None
            return held
        with self._foremost:
            frame = self.rig.camera.grab(self.timeout)
        if self._sequence is not None:
            # Numbers start again when the camera does, or a recording is played again.
            self.counts.dropped += max(0, frame.sequence - self._sequence - 1)
        self._sequence = frame.sequence
        return frame

    def grab_patiently(self) -> Frame:
        """The next frame, however long none was recorded; stopping ends the wait."""
        while True:
            try:
                return self.grab()
            except DeviceTimeoutError:
                self.rig.beat()

    def grab_fresh(self, still: int) -> Frame:
        """The next frame whose exposure began at `still` (ns) or later; raises as `grab`."""
        for _ in range(_STALE):
            frame = self.grab()
            if self.rig.camera.exposure_start(frame) >= still:
                return frame
            self.counts.stale += 1
        raise OperationError(
            f"{_STALE} frames in a row were exposed before the stage stood still; expected their times to "
            "follow the host's clock: check the camera's timestamps"
        )

    def put_back(self, frame: Frame) -> None:
        """Have the next `grab` give this one again: it belongs to the next burst."""
        self._held = frame

    def keep(self, frame: Frame) -> Frame:
        """Count a frame that belongs to a burst, and show it."""
        self.counts.frames += 1
        self.counts.error = ""  # whatever it was, frames come again
        self._listener(frame)
        return frame

    def restart(self) -> None:
        """Forget the last number: frames may have passed that nobody wanted."""
        self._sequence = None
