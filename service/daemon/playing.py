"""A recording stands for the camera: played, paused, stepped through, searched; in bursts, or a stream."""

from __future__ import annotations

import logging
from collections.abc import Callable
from itertools import count
from typing import TYPE_CHECKING, Literal

from drivers.errors import DriverError, EndOfRecordingError
from drivers.frame import Frame
from service.capture.carried import numbered
from service.capture.control import StoppedError
from service.capture.player import Player, Shot, Stepped
from service.capture.rig import Rig
from service.daemon.agenda import Done
from service.daemon.heartbeat import Heartbeat
from service.daemon.replay_state import replay_state
from service.daemon.step import Step
from service.errors import InvalidStateError, ServiceError
from service.fusion.job import BurstJob, FrameJob, Job
from service.messages.burst import Burst, check_frame
from service.messages.events import BurstCaptured, FrameCaptured, ReplayTold
from service.messages.map import FusedMap
from service.messages.replay import ReplayState
from service.messages.status import State

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

_LOOK = 0.2
"""Seconds after which whoever stands still looks again though nobody woke it."""

_TELL = 0.2
"""Seconds from one state told to the next while it plays; otherwise every fifth."""

_AHEAD = 2
"""Frames of a stream that wait for their map; none is passed over."""

Kind = Literal["scan", "stream"]
_log = logging.getLogger(__name__)


class SoughtError(ServiceError):
    """The replay was sent elsewhere."""


class Playing:
    """Plays a recording until told otherwise; at its end it stands still, unless that `ends` it.

    Args:
        daemon: at work.
        rig: the recording for a camera, open; closed by the daemon when something else begins.
        player: of that recording.
        name: what it is called in the recording folder.
        kind: a map of each burst, or of the last frames with every frame.
        ends: it is over at the end of the recording.
    """

    def __init__(
        self, daemon: Daemon, rig: Rig, player: Player, name: str, kind: Kind, *, ends: bool = False
    ) -> None:
        self._daemon, self.rig, self.player = daemon, rig, player
        self.name, self.kind, self._ends = name, kind, ends
        self.state: State = "scanning" if kind == "scan" else "streaming"
        self._step = Step(player, daemon.emit)
        self._error: str | None = None
        self._beats = 0

    @property
    def reason(self) -> str:
        """Whether it goes on."""
        return f"{'playing' if self.player.playing else 'a replay stands still in'} {self.name}"

    def prepare(self) -> None: ...

    def anew(self) -> Playing:
        """The same from the burst at work on, with what is configured now."""
        player, frames = self.player, self._daemon.configuration.fusion.frames
        if self.kind == "scan" and not player.at_burst:
            player.seek(player.bursts.first(player.burst))
            player.sought = False  # nothing is given up for that
        player.cut(frames)
        return Playing(self._daemon, self.rig, player, self.name, self.kind, ends=self._ends)

    def run(self) -> None:
        take = self._take_bursts if self.kind == "scan" else self._take_frames
        self.told()
        with Heartbeat(self._beat, _TELL):
            while True:
                try:
                    take()
                except SoughtError:
                    continue
                except StoppedError:
                    break
                except EndOfRecordingError:
                    return
                except DriverError as error:
                    self._fail(error)
        following = self._daemon.agenda.next
        if not (isinstance(following, Playing) and following.player is self.player):
            self._step.fail(InvalidStateError("the replay ended meanwhile"))
            self._daemon.fusing.backlog.clear()

    def change(self, do: Callable[[Player], None]) -> None:
        """Change how it is played; for the thread that runs it."""
        self._error, self._ends = None, False  # somebody looks after it
        was_stepping = self.player.stepping
        do(self.player)
        if was_stepping or self.player.sought:
            self._step.fail(InvalidStateError("something else was asked for meanwhile"))
        if self.player.sought:
            self._daemon.fusing.backlog.clear()
        self.told()

    def step(self, frames: int) -> Stepped:
        """Play some frames and stand still; done when their last map is published, with its report."""
        self.change(lambda player: player.step(frames))
        self.player.stepped = stepped = Stepped()
        return stepped

    def once(self) -> None:
        """Have a burst come, also where it stands still; for the thread that runs it.

        Raises:
            InvalidStateError: at the end, or where it streams.
        """
        if self.kind == "stream":
            raise InvalidStateError("a recording is streamed: end that first, with cmd/replay stop")
        if self.player.ended:
            raise InvalidStateError("the replay is at its end: seek first, or play it again")
        if not (self.player.playing or self.player.stepping):
            self.change(lambda player: player.step(player.frames_of_bursts(1)))

    def told(self) -> None:
        """Tell where it is."""
        self._daemon.states.enter(self.state, self.reason)
        self._daemon.emit(ReplayTold(self.replay))

    @property
    def replay(self) -> ReplayState:
        """Where it is."""
        now = self._daemon.rig.clock.now()
        return replay_state(self.player, self.name, self.kind, now, self._error)

    def _take_bursts(self) -> None:
        """Burst after burst."""
        daemon = self._daemon
        for number in count(1):
            burst, is_last = self._burst(daemon.configuration.fusion.backlog)
            daemon.grabber.counts.bursts += 1
            daemon.emit(BurstCaptured(burst, number))
            turn = daemon.agenda.turn()
            job = BurstJob(burst, daemon.configuration.fusion, awaited=turn is not None)
            self._hand_over(job, is_last, turn)

    def _burst(self, room: int) -> tuple[Burst, bool]:
        bursts = self.player.bursts
        shot = self._next(room)
        place = bursts.of(shot.number)
        calibration, burst, frames = shot.calibration, place + shot.rounds * len(bursts), []
        while True:
            frame = numbered(shot.frame, burst, shot.number - bursts.first(place))
            self._tell_frame(shot, frame)
            frames.append(frame)
            if shot.number + 1 >= bursts.end(place):
                break
            if shot.is_last:
                self._step.end()
            shot = self._next(None)
        made = Burst(frames[0].burst or 0, tuple(frames), calibration, bursts.expected[place])
        return made, shot.is_last

    def _take_frames(self) -> None:
        """Frame after frame into a window; with another camera or modulation the window begins anew."""
        daemon = self._daemon
        settings, last, stream, number = daemon.configuration, None, 0, 0
        while True:
            shot = self._next(_AHEAD)
            kind = shot.calibration, shot.frame.modulation_frequency, shot.frame.ambiguity_range
            if kind != last:
                last, stream, number = kind, daemon.fusing.next_stream(), 0
            check_frame(shot.frame, shot.calibration)
            self._tell_frame(shot, shot.frame)
            window = settings.stream.window
            job = FrameJob(shot.frame, shot.calibration, settings.fusion, window, stream, number)
            self._hand_over(job, shot.is_last)
            number += 1

    def _next(self, room: int | None) -> Shot:
        """The next frame, when it is due and, where it begins something, there is `room` for that to wait."""
        player, control, daemon = self.player, self._daemon.control, self._daemon
        while True:
            stands = not (player.playing or player.stepping)
            control.inbox.serve("burst" if room is not None or stands else "pose")
            control.check()
            if daemon.ending:
                raise StoppedError("something else was asked for")
            if self._ends and player.ended:
                raise EndOfRecordingError(f"{self.name} has been played to its end")
            if player.sought:
                player.sought = False
                raise SoughtError(f"{self.name}: sent elsewhere")
            is_full = room is not None and daemon.fusing.backlog.waiting >= room
            wait = None if is_full else player.wait()
            if wait is not None and wait <= 0:
                return player.take()
            control.beat()
            control.inbox.wait(_LOOK if wait is None else min(wait, _LOOK))

    def _tell_frame(self, shot: Shot, frame: Frame) -> None:
        daemon = self._daemon
        daemon.grabber.counts.frames += 1
        daemon.emit(FrameCaptured(frame, shot.calibration.mount))
        if self.player.ended or shot.is_last:
            self.told()

    def _hand_over(self, job: Job, is_last: bool, turn: Done | None = None) -> None:
        daemon = self._daemon
        stepped = self.player.stepped if is_last else None

        def done(result: FusedMap | Exception) -> None:
            daemon.control.inbox.wake()
            if stepped is not None:
                self._step.answer(stepped, result)
            if turn is not None:
                turn(result)

        room = max(_AHEAD, daemon.configuration.fusion.backlog)
        daemon.fusing.backlog.put(job, room, daemon.stop.is_set, done)

    def _fail(self, error: DriverError) -> None:
        """Stand still over what cannot be played, and say so until it is told to do something else."""
        _log.error("replay: %s", error)
        self.player.pause()
        self._error = str(error)
        self._step.fail(error)
        self.told()

    def _beat(self) -> None:
        self._beats += 1
        if self.player.playing or self._beats % 5 == 0:
            self._daemon.emit(ReplayTold(self.replay))
