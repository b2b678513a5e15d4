"""Takes a burst: from a turning camera by a plan, or from frames that already say where they belong."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

from drivers.bursts import BurstCutter, ExpectedFrames
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    EndOfRecordingError,
    OperationError,
)
from drivers.frame import Frame
from drivers.position import Position
from service.capture.control import Control
from service.capture.rig import Rig
from service.messages.burst import Burst
from service.planning.plan import Plan

_ATTEMPTS = 4
"""Times in a row that one frame may fail before the camera is opened again."""

_STALE = 100
"""Stale frames in a row that cannot be what was still in the camera's buffers."""

T_co = TypeVar("T_co", covariant=True)

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


class Source(Protocol[T_co]):
    """A way to take bursts, or the frames of a stream."""

    def take(self, number: int) -> T_co:
        """The burst, or the stream's frame, of that number; raises as the devices do."""


class Grabber:
    """Grabs frames, counts what is missing between them, and shows each one it keeps to a listener."""

    def __init__(
        self, rig: Rig, timeout: float, control: Control, listener: Callable[[Frame], None] = lambda _: None
    ) -> None:
        self.rig, self.control = rig, control
        self.counts = CaptureCounts()
        self._timeout = timeout
        rig.stage.interrupted = lambda: control.halted
        self._listener = listener
        self._sequence: int | None = None
        self._held: Frame | None = None

    def grab(self) -> Frame:
        """The next frame; raises as `Camera.grab`, and `StoppedError` once stopped or cancelled."""
        self.control.check()
        if self._held is not None:
            held, self._held = self._held, None
            return held
        frame = self.rig.camera.grab(self._timeout)
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
                continue

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


@dataclass(frozen=True, slots=True)
class _Stand:
    """Where the stage was sent, where it then reported to be, and from when on it surely stood still (ns)."""

    target: Position
    position: Position
    still: int


class ScanBursts:
    """Bursts by a plan: for each pose move, settle, throw stale frames away, grab.

    Args:
        grabber: gives frames.
        plan: poses of one burst.
        settle: seconds to stand still before an exposure may begin.
        move_timeout: seconds that a movement may take longer than at the stage's speed.
        begun: frames of the first poses of the first burst, captured before.
    """

    def __init__(
        self,
        grabber: Grabber,
        plan: Plan,
        settle: float,
        move_timeout: float,
        begun: Sequence[Frame] = (),
    ) -> None:
        self._begun = begun
        self._grabber, self._rig = grabber, grabber.rig
        self._plan, self._settle, self._move_timeout = plan, settle, move_timeout
        self._stand: _Stand | None = None

    def take(self, number: int) -> Burst:
        begun, self._begun = self._begun, ()
        frames = [self._grabber.keep(frame) for frame in begun]
        frames += [self.frame(number, pose) for pose in range(len(frames), len(self._plan))]
        self._grabber.counts.bursts += 1
        return Burst(number, tuple(frames), self._rig.calibration, len(self._plan))

    def frame(self, number: int | None, pose: int) -> Frame:
        """The frame of a pose, as part of a burst where it has a number; tried again some times."""
        try:
            self._grabber.control.between_poses()
            self._turn(pose)
            return self._tried(number, pose)
        except OperationError:
            self._stand = None  # the devices will be opened again, and may move at that
            raise

    def _tried(self, number: int | None, pose: int) -> Frame:
        last: OperationError | None = None
        for _ in range(_ATTEMPTS):
            try:
                return self._attempt(number, pose)
            except (DeviceLostError, EndOfRecordingError):
                raise
            except OperationError as error:
                self._grabber.counts.faults += 1
                self._grabber.counts.error = str(error)
                _log.warning("burst %s, pose %d: %s; trying again", number, pose, error)
                last = error
        raise DeviceLostError(f"pose {pose} failed {_ATTEMPTS} times in a row, lastly: {last}") from last

    def _turn(self, pose: int) -> None:
        """Turn to a pose; where the stage stands there already, nothing moves, and no frame becomes stale."""
        motion, target, last = self._rig.motion, self._plan.poses[pose], self._stand
        self._stand = None
        if self._rig.stage.needs_home:
            last = None
        motion.prepare(self._plan.poses)
        if last is not None and last.target == target and last.position == motion.position:
            self._stand = last
            return
        if self._plan.moves:
            self._grabber.restart()  # frames that pass while the stage moves are not missed
        motion.go(target, self._move_timeout)
        still = self._rig.clock.now() + round(self._settle * 1e9)
        self._stand = _Stand(target, motion.position, still)

    def _attempt(self, number: int | None, pose: int) -> Frame:
        assert self._stand is not None
        frame = self._grabber.grab_fresh(self._stand.still)
        position = self._rig.motion.position
        numbers = (None, None) if number is None else (number, pose)
        placed = replace(frame, pan=position.pan, tilt=position.tilt, burst=numbers[0], pose=numbers[1])
        return self._grabber.keep(placed)


class CarriedBursts:
    """Bursts of a camera whose frames bring their own angles, burst and pose (a recording does).

    `BurstCutter` says where one ends, `ExpectedFrames` what it lacks.

    Args:
        grabber: gives frames.
        frames: frames of a burst that has no id.
        planned: frames of any other, where that is known.
    """

    def __init__(self, grabber: Grabber, frames: int, planned: int | None = None) -> None:
        self._grabber, self._rig = grabber, grabber.rig
        self._length = frames
        self._cutter, self._expected = BurstCutter(frames), ExpectedFrames(frames, planned)

    def take(self, number: int) -> Burst:
        first = self._grab_first()
        calibration = self._rig.calibration
        frames = [self._grabber.keep(_numbered(first, number, 0))]
        # A burst that is cut by number is complete without a look at the next frame.
        while first.burst is not None or len(frames) < self._length:
            self._grabber.control.between_poses()
            try:
                frame = self._grabber.grab_patiently()
            except EndOfRecordingError:
                break
            if self._begins(frame):
                self._grabber.put_back(frame)
                break
            frames.append(self._grabber.keep(_numbered(frame, number, len(frames))))
        expected = self._expected.of(frames) if first.burst is not None else self._length
        self._grabber.counts.bursts += 1
        return Burst(frames[0].burst or 0, tuple(frames), calibration, expected)

    def _grab_first(self) -> Frame:
        frame = self._grabber.grab_patiently()
        self._begins(frame)
        return frame

    def _begins(self, frame: Frame) -> bool:
        return self._cutter.begins(frame, frame.shape, self._rig.calibration)


def _numbered(frame: Frame, burst: int, pose: int) -> Frame:
    return replace(
        frame,
        burst=frame.burst if frame.burst is not None else burst,
        pose=frame.pose if frame.pose is not None else pose,
    )
