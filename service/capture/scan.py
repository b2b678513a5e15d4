"""Bursts of a camera that a stage turns by a plan."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.errors import DeviceLostError, EndOfRecordingError, OperationError
from drivers.frame import Frame
from drivers.position import Position
from service.capture.agreement import require_agreement
from service.capture.grabber import Grabber
from service.messages.burst import Burst
from service.planning.plan import Plan

_ATTEMPTS = 4
"""Times in a row that one frame may fail before the camera is opened again."""

_NOTABLE = 0.5
"""Seconds by which a clock is set that are worth a line."""

_log = logging.getLogger(__name__)


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
        self._correction = 0

    def take(self, number: int) -> Burst:
        begun, self._begun = self._begun, ()
        frames = [self._grabber.keep(frame) for frame in begun]
        frames += [self.frame(number, pose) for pose in range(len(frames), len(self._plan))]
        stage = self._rig.stage
        reported = [Position(frame.pan, frame.tilt) for frame in frames]
        require_agreement(str(stage), self._plan.poses, reported, stage.resolution)
        self._grabber.counts.bursts += 1
        exposed = self._rig.exposed(frames[-1])
        return Burst(number, tuple(frames), self._rig.calibration, len(self._plan), exposed)

    def frame(self, number: int | None, pose: int) -> Frame:
        """The frame of a pose, as part of a burst where it has a number; tried again some times."""
        if pose == 0:
            self._set_clock()
        try:
            self._grabber.control.between_poses()
            self._turn(pose)
            return self._tried(number, pose)
        except OperationError:
            self._stand = None  # the devices will be opened again, and may move at that
            raise

    def _set_clock(self) -> None:
        """Follow a clock that was set meanwhile, between two bursts: within one, times shall not jump."""
        correction = self._rig.clock.correction()
        moved = (correction - self._correction) / 1e9
        if abs(moved) > _NOTABLE:
            _log.warning("the clock was set by %+.1f s; frames are stamped accordingly", moved)
        self._correction = correction

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
        placed = replace(
            frame,
            timestamp=frame.timestamp + self._correction,
            pan=position.pan,
            tilt=position.tilt,
            burst=numbers[0],
            pose=numbers[1],
        )
        return self._grabber.keep(placed)
