"""`cmd/replay`: a recording stands for the camera."""

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Literal, Self, TypeVar

from pydantic import Field, model_validator

from drivers.errors import DriverError
from drivers.fixed import FixedStage
from drivers.replay import ReplayCamera, ReplayOptions
from service.capture.player import Player
from service.capture.rig import Rig
from service.daemon.desk import Desk
from service.daemon.modes import Idle
from service.daemon.playing import Kind, Playing
from service.daemon.verb import Answer, Command, Outcome, Place, Reply, Verb, then
from service.errors import InvalidArgumentError, InvalidStateError, OutOfRangeError
from service.messages.replay import ReplayState
from service.messages.report import BurstReport
from service.sinks.folder import found_in

N = TypeVar("N", int, float)

_SPEED = "Times real time; null = as fast as it can be fused."


class ReplayReply(Reply):
    """Where the replay is."""

    replay: ReplayState = Field(description="What is in force.")
    report: BurstReport | None = Field(None, description="How the fusion went; of a `step` with a map.")


class Load(Verb):
    """Open a recording, in place of the camera; whatever is at work ends after its burst."""

    place: ClassVar[Place] = "aside"
    action: Literal["load"]
    file: str = Field(min_length=1, max_length=255, description="In the recording folder.")
    mode: Kind = Field("scan", description="A map of each burst, or of the last frames with every frame.")
    play: bool = Field(False, description="Go on by itself at once; else it stands before the first frame.")
    speed: float | None = Field(1.0, gt=0, le=1000, description=_SPEED)
    loop: bool = Field(False, description="Begin again at the end.")

    def carry_out(self, desk: Desk) -> Answer:
        desk.refuse_paused()
        folder = desk.daemon.configuration.recording.directory
        path = found_in(folder, self.file)
        rig = _opened(path)
        player = Player(
            rig.camera.reel,  # type: ignore[attr-defined]
            desk.daemon.configuration.fusion.frames,
            speed=self.speed,
            loop=self.loop,
            playing=self.play,
        )
        name = str(path.relative_to(folder.resolve()))
        begun = desk.daemon.ask(Playing(desk.daemon, rig, player, name, self.mode))
        begun.add_done_callback(lambda done: None if done.exception() is None else rig.close())
        return then(begun, lambda _: Outcome(_reply(desk)))


class Play(Verb):
    """Go on; from the beginning where it was at the end."""

    action: Literal["play"]

    def carry_out(self, desk: Desk) -> Answer:
        return _change(desk, lambda playing: playing.change(Player.play))


class Pause(Verb):
    """Stand still after the frame at work."""

    action: Literal["pause"]

    def carry_out(self, desk: Desk) -> Answer:
        return _change(desk, lambda playing: playing.change(Player.pause))


class Step(Verb):
    """Play some bursts or frames at once, and stand still; answered once their last map is published."""

    action: Literal["step"]
    unit: Literal["burst", "frame"] | None = Field(
        None, description="null = bursts of a scan, frames of a stream."
    )
    count: int = Field(1, ge=1, le=10_000, description="How many; none beyond the end.")

    def carry_out(self, desk: Desk) -> Answer:
        _ = desk.playing
        return desk.daemon.control.inbox.submit(lambda: self._step(desk, desk.playing), "pose")

    def _step(self, desk: Desk, playing: Playing) -> Answer:
        player = playing.player
        if player.ended:
            raise InvalidStateError("the replay is at its end: seek first, or play it again")
        unit = self.unit or ("burst" if playing.kind == "scan" else "frame")
        frames = self.count if unit == "frame" else player.frames_of_bursts(self.count)
        return then(playing.step(frames), lambda report: Outcome(_reply(desk, report)))


class Seek(Verb):
    """Go elsewhere: to a second, a burst or a frame; a stream begins anew there, a scan at a whole burst."""

    action: Literal["seek"]
    seconds: float | None = Field(None, ge=0, description="From the first frame, gaps cut short.")
    burst: int | None = Field(None, ge=0, description="Its first frame; from 0.")
    frame: int | None = Field(None, ge=0, description="This very frame, also within a burst; from 0.")

    @model_validator(mode="after")
    def _says_one_place(self) -> Self:
        if sum(place is not None for place in (self.seconds, self.burst, self.frame)) != 1:
            raise ValueError("expected one of seconds, burst and frame")
        return self

    def carry_out(self, desk: Desk) -> Answer:
        return _change(desk, lambda playing: playing.change(lambda player: player.seek(self._place(playing))))

    def _place(self, playing: Playing) -> int:
        player = playing.player
        bursts, line = player.bursts, player.reel.line
        if self.burst is not None:
            return bursts.first(_within("burst", self.burst, len(bursts) - 1))
        if self.frame is not None:
            return _within("frame", self.frame, len(line) - 1)
        assert self.seconds is not None
        frame = line.at(round(_within("seconds", self.seconds, line.duration / 1e9) * 1e9))
        return bursts.first(bursts.of(frame)) if playing.kind == "scan" else frame


class Speed(Verb):
    """Play faster or slower."""

    action: Literal["speed"]
    speed: float | None = Field(gt=0, le=1000, description=_SPEED)

    def carry_out(self, desk: Desk) -> Answer:
        return _change(desk, lambda playing: playing.change(lambda player: player.set_speed(self.speed)))


class Loop(Verb):
    """Begin again at the end, or not."""

    action: Literal["loop"]
    loop: bool = Field(description="Whether it begins again at the end.")

    def carry_out(self, desk: Desk) -> Answer:
        return _change(
            desk, lambda playing: playing.change(lambda player: setattr(player, "loop", self.loop))
        )


class Stop(Verb):
    """End the replay; the service is idle then."""

    action: Literal["stop"]

    def carry_out(self, desk: Desk) -> Answer:
        if not desk.is_playing:
            return _reply(desk)
        begun = desk.daemon.ask(Idle(desk.daemon))
        return then(begun, lambda _: Outcome(_reply(desk)))


class Get(Verb):
    """Where it is."""

    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return _reply(desk)


def _opened(path: Path) -> Rig:
    rig = Rig(ReplayCamera(ReplayOptions(path=path)), FixedStage())
    try:
        rig.open()
    except DriverError as error:
        raise InvalidArgumentError(str(error)) from error
    return rig


def _change(desk: Desk, do: Callable[[Playing], None]) -> Answer:
    """Have the thread that plays do it, before its next frame; refused at once where nothing is played."""
    _ = desk.playing

    def carry_out() -> ReplayReply:
        do(desk.playing)
        return _reply(desk)

    return desk.daemon.control.inbox.submit(carry_out, "pose")


def _reply(desk: Desk, report: BurstReport | None = None) -> ReplayReply:
    known = {} if report is None else {"report": report}
    return desk.reply(ReplayReply, replay=desk.daemon.replay, **known)


def _within(name: str, value: N, most: float) -> N:
    if value > most:
        raise OutOfRangeError(f"{name} = {value:g}: expected at most {most:g}, where the recording ends")
    return value


COMMAND = Command(
    "cmd/replay",
    "A recording stands for the camera.",
    (Load, Play, Pause, Step, Seek, Speed, Loop, Stop, Get),
    ReplayReply,
)
