"""Takes bursts: from a turning camera by a plan, or from frames that already say where they belong."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from threading import Event
from typing import Protocol

from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    EndOfRecordingError,
    MotionStoppedError,
    OperationError,
)
from drivers.frame import Frame
from service.capture.burst import Burst
from service.capture.plan import Plan
from service.capture.rig import Rig
from service.errors import ServiceError

_ATTEMPTS = 4
"""Times in a row that one frame may fail before the camera is opened again."""

_STALE = 100
"""Stale frames in a row that cannot be what was still in the camera's buffers."""

_log = logging.getLogger(__name__)


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
        error: the last fault, in words; empty = none.
    """

    frames: int = 0
    stale: int = 0
    dropped: int = 0
    faults: int = 0
    lost: int = 0
    interrupted: int = 0
    bursts: int = 0
    error: str = ""


class Bursts(Protocol):
    """A way to gather frames into bursts."""

    def take(self, number: int) -> Burst:
        """One burst; raises as the devices do."""


class StoppedError(ServiceError):
    """The capture was told to stop in the middle of a burst."""


class Grabber:
    """Grabs frames, counts what is missing between them, and shows each one it keeps to a listener."""

    def __init__(
        self, rig: Rig, timeout: float, stop: Event, listener: Callable[[Frame], None] = lambda _: None
    ) -> None:
        self.rig, self.stop = rig, stop
        self.counts = CaptureCounts()
        self._timeout = timeout
        rig.stage.interrupted = stop.is_set
        self._listener = listener
        self._sequence: int | None = None

    def grab(self) -> Frame:
        """The next frame; raises as `Camera.grab`, and `StoppedError` once `stop` is set."""
        if self.stop.is_set():
            raise StoppedError("the capture was stopped")
        frame = self.rig.camera.grab(self._timeout)
        if self._sequence is not None:
            # Numbers start again when the camera does, or a recording is played again.
            self.counts.dropped += max(0, frame.sequence - self._sequence - 1)
        self._sequence = frame.sequence
        return frame

    def keep(self, frame: Frame) -> Frame:
        """Count a frame that belongs to a burst, and show it."""
        self.counts.frames += 1
        self._listener(frame)
        return frame

    def restart(self) -> None:
        """Forget the last number: frames may have passed that nobody wanted."""
        self._sequence = None


class ScanBursts:
    """Bursts by a plan: for each pose move, settle, throw stale frames away, grab.

    Args:
        grabber: gives frames.
        plan: poses of one burst.
        settle: seconds to stand still before an exposure may begin.
        move_timeout: seconds that a movement may take longer than at the stage's speed.
    """

    def __init__(self, grabber: Grabber, plan: Plan, settle: float, move_timeout: float) -> None:
        self._grabber, self._rig = grabber, grabber.rig
        self._plan, self._settle, self._move_timeout = plan, settle, move_timeout

    def take(self, number: int) -> Burst:
        frames = [self._frame(number, pose) for pose in range(len(self._plan))]
        return Burst(number, tuple(frames), self._rig.calibration, len(self._plan))

    def _frame(self, number: int, pose: int) -> Frame:
        self._turn(pose)
        last: OperationError | None = None
        for _ in range(_ATTEMPTS):
            try:
                return self._attempt(number, pose)
            except (DeviceLostError, EndOfRecordingError):
                raise
            except OperationError as error:
                self._grabber.counts.faults += 1
                self._grabber.counts.error = str(error)
                _log.warning("burst %d, pose %d: %s; trying again", number, pose, error)
                last = error
        raise DeviceLostError(f"pose {pose} failed {_ATTEMPTS} times in a row, lastly: {last}") from last

    def _turn(self, pose: int) -> None:
        motion = self._rig.motion
        motion.prepare(self._plan.poses)
        if self._plan.moves:
            self._grabber.restart()  # frames that pass while the stage moves are not missed
        motion.go(self._plan.poses[pose], self._move_timeout)
        self._still = self._rig.clock.now() + round(self._settle * 1e9)

    def _attempt(self, number: int, pose: int) -> Frame:
        frame = self._fresh(self._still)
        position = self._rig.motion.position
        placed = replace(frame, pan=position.pan, tilt=position.tilt, burst=number, pose=pose)
        return self._grabber.keep(placed)

    def _fresh(self, still: int) -> Frame:
        for _ in range(_STALE):
            frame = self._grabber.grab()
            if exposure_start(frame) >= still:
                return frame
            self._grabber.counts.stale += 1
        raise OperationError(
            f"{_STALE} frames in a row were exposed before the stage stood still; expected their times to "
            "follow the host's clock: check the camera's timestamps"
        )


class CarriedBursts:
    """Bursts of a camera whose frames bring their own angles, burst and pose (a recording does).

    A burst ends where the burst id changes, the numbers start again, or the recording ends; frames without
    an id are cut into groups of `frames`. One with an id lacks frames where poses are missing in it, or
    where an earlier one had more.
    """

    def __init__(self, grabber: Grabber, frames: int) -> None:
        self._grabber, self._rig = grabber, grabber.rig
        self._length = frames
        self._fullest = 0
        self._next: Frame | None = None

    def take(self, number: int) -> Burst:
        first = self._next or self._grab()
        self._next = None
        frames = [self._grabber.keep(_numbered(first, number, 0))]
        while first.burst is not None or len(frames) < self._length:
            try:
                frame = self._grab()
            except EndOfRecordingError:
                break
            if frame.burst != first.burst or frame.sequence <= frames[-1].sequence:
                self._next = frame
                break
            frames.append(self._grabber.keep(_numbered(frame, number, len(frames))))
        expected = self._length
        if first.burst is not None:
            poses = max(frame.pose or 0 for frame in frames) + 1
            expected = self._fullest = max(self._fullest, poses, len(frames))
        return Burst(frames[0].burst or 0, tuple(frames), self._rig.calibration, expected)

    def _grab(self) -> Frame:
        while True:
            try:
                return self._grabber.grab()
            except DeviceTimeoutError:
                continue  # nothing was recorded for a while; stopping ends the wait


class Capture:
    """Takes burst after burst and survives what happens to the devices.

    Args:
        grabber: gives frames of the (open) rig.
        bursts: gathers them.
        pause: seconds between bursts.
    """

    def __init__(self, grabber: Grabber, bursts: Bursts, pause: float = 0.0) -> None:
        self.counts = grabber.counts
        self._grabber, self._rig = grabber, grabber.rig
        self._bursts, self._pause = bursts, pause

    def run(self) -> Iterator[Burst]:
        """Bursts until the grabber is stopped or a recording ends; an interrupted burst is taken again.

        Raises:
            MotionError: the stage must not move any more.
        """
        number, stop = 0, self._grabber.stop
        while not stop.is_set():
            try:
                burst = self._bursts.take(number)
            except (EndOfRecordingError, StoppedError, MotionStoppedError):
                return
            except OperationError as error:
                self.counts.lost += 1
                self.counts.interrupted += 1
                self.counts.error = str(error)
                _log.error("burst %d interrupted: %s; opening the devices again", number, error)
                if not self._rig.reopen(stop.is_set):
                    return
                self._grabber.restart()
                continue
            self.counts.bursts += 1
            number += 1
            yield burst
            self._rig.wait(self._pause, stop.is_set)


def exposure_start(frame: Frame) -> int:
    """The earliest time at which the exposure of a frame may have begun, ns since the epoch.

    A frame is four phase samples about its timestamp; readout between them makes it a little longer.
    """
    half = 2 * (frame.integration_time or 0.0)
    return frame.timestamp - frame.timestamp_uncertainty - round(half * 1e9)


def _numbered(frame: Frame, burst: int, pose: int) -> Frame:
    return replace(
        frame,
        burst=frame.burst if frame.burst is not None else burst,
        pose=frame.pose if frame.pose is not None else pose,
    )
