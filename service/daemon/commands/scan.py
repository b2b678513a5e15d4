"""`cmd/scan`: bursts by the plan, continuously or one on request."""

from concurrent.futures import Future
from typing import ClassVar, Literal

from pydantic import Field

from service.daemon.desk import Desk
from service.daemon.modes import Scanning, planned
from service.daemon.playing import Playing
from service.daemon.verb import Answer, Command, Outcome, Place, Reply, Verb, then
from service.errors import InvalidStateError
from service.messages.encoding import fused_messages
from service.messages.events import Delivery
from service.messages.map import FusedMap
from service.messages.report import BurstReport
from service.planning.check import ScanCheck, check_scan
from service.planning.estimate import estimate_plan

_LOOKED_AT = 5
"""Frames from which exposure and noise are taken."""


class ScanReply(Reply):
    """Where the scan is."""

    report: BurstReport | None = Field(None, description="How the fusion went; of `once`.")
    check: ScanCheck | None = Field(None, description="What a burst would give; of `check`.")


class Start(Verb):
    """Scan burst after burst; one that is being streamed ends."""

    place: ClassVar[Place] = "burst"
    action: Literal["start"]

    def carry_out(self, desk: Desk) -> Answer:
        desk.require_devices()
        if isinstance(desk.mode, Scanning) and not desk.mode.asked and not desk.daemon.ending:
            return desk.reply(ScanReply)
        begun = desk.daemon.begin(Scanning(desk.daemon))
        return then(begun, lambda _: Outcome(desk.reply(ScanReply)))


class Stop(Verb):
    """End after the burst at work; answered at once."""

    action: Literal["stop"]

    def carry_out(self, desk: Desk) -> Answer:
        _refuse_stream(desk)
        if desk.daemon.control.paused:
            raise InvalidStateError("paused in a burst: resume it, or cancel it")
        if desk.is_scanning:
            desk.daemon.rest()
        return desk.reply(ScanReply)


class Cancel(Verb):
    """End at once; the burst at work is discarded."""

    action: Literal["cancel"]

    def carry_out(self, desk: Desk) -> Answer:
        _refuse_stream(desk)
        if desk.is_scanning:
            desk.daemon.control.cancel()
            desk.daemon.rest()
        return desk.reply(ScanReply)


class Once(Verb):
    """One burst; answered once its map is published."""

    place: ClassVar[Place] = "burst"
    action: Literal["once"]
    map: bool = Field(
        False, description="Have the fused messages follow the reply, each with its topic as attachment."
    )

    def carry_out(self, desk: Desk) -> Answer:
        daemon, answer = desk.daemon, Future[Outcome]()
        if isinstance(desk.mode, Playing):
            desk.mode.once()
            daemon.agenda.queue(lambda result: self._fused(desk, answer, result))
            return answer
        _refuse_stream(desk)
        following = daemon.agenda.next or desk.mode
        mode = following if isinstance(following, Scanning) else Scanning(daemon, asked=True)
        if mode is not following:
            mode.prepare()
        daemon.agenda.queue(lambda result: self._fused(desk, answer, result))
        if mode is not following:
            daemon.agenda.ask(mode)
        return answer

    def _fused(self, desk: Desk, answer: "Future[Outcome]", result: FusedMap | Exception) -> None:
        if isinstance(result, Exception):
            answer.set_exception(result)
        else:
            desk.daemon.emit(Delivery(lambda: answer.set_result(self._outcome(desk, result))))

    def _outcome(self, desk: Desk, result: FusedMap) -> Outcome:
        reply = desk.reply(ScanReply, report=result.report)
        return Outcome(reply, fused_messages(result) if self.map else ())


class Check(Verb):
    """What a burst would give: nothing moves, a few frames are looked at."""

    place: ClassVar[Place] = "burst"
    changes: ClassVar[bool] = False
    action: Literal["check"]

    def carry_out(self, desk: Desk) -> Answer:
        daemon = desk.daemon
        if daemon.carries_pose:
            raise InvalidStateError("poses and exposure are those of a recording or of another rig")
        settings, rig, grabber = daemon.configuration, daemon.rig, daemon.grabber
        plan = planned(settings, rig, settings.fusion.frames)
        section = settings.plan
        expected = estimate_plan(
            plan, rig.calibration, settings.fusion.upsampling, section.nearest, section.farthest
        )
        now = rig.clock.now()
        grabber.restart()
        frames = [grabber.grab_fresh(now) for _ in range(_LOOKED_AT)]
        found = check_scan(plan, expected, frames, settle=settings.stage.settle, speed=rig.stage.speed)
        return desk.reply(ScanReply, check=found)


class Pause(Verb):
    """Stand still after the pose at work."""

    action: Literal["pause"]

    def carry_out(self, desk: Desk) -> Answer:
        _require_scan(desk)
        desk.daemon.control.pause()
        return desk.reply(ScanReply)


class Resume(Verb):
    """Go on with the burst that was paused."""

    action: Literal["resume"]

    def carry_out(self, desk: Desk) -> Answer:
        _require_scan(desk)
        desk.daemon.control.resume()
        return desk.reply(ScanReply)


def _require_scan(desk: Desk) -> None:
    desk.refuse_replay()
    if not desk.is_scanning:
        raise InvalidStateError(f"{desk.daemon.states.state}: there is no scan; start one first")


def _refuse_stream(desk: Desk) -> None:
    desk.refuse_replay()
    if desk.is_streaming:
        raise InvalidStateError("streaming: end the stream first, with cmd/stream stop")


COMMAND = Command(
    "cmd/scan",
    "Bursts by the plan, each fused into a map.",
    (Start, Stop, Cancel, Once, Pause, Resume, Check),
    ScanReply,
)
