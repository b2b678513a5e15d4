"""`cmd/scan`: bursts by the plan, continuously or one on request."""

from concurrent.futures import Future
from typing import ClassVar, Literal

from pydantic import Field

from service.daemon.desk import Desk
from service.daemon.modes import Scanning
from service.daemon.verb import Answer, Command, Outcome, Place, Reply, Verb, then
from service.errors import InvalidStateError
from service.messages.encoding import fused_messages
from service.messages.events import Delivery
from service.messages.map import FusedMap
from service.messages.report import BurstReport


class ScanReply(Reply):
    """Where the scan is."""

    report: BurstReport | None = Field(None, description="How the fusion went; of `once`.")


class Start(Verb):
    """Scan burst after burst; one that is being streamed ends."""

    place: ClassVar[Place] = "burst"
    action: Literal["start"]

    def carry_out(self, desk: Desk) -> Answer:
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
            desk.daemon.request("idle")
        return desk.reply(ScanReply)


class Cancel(Verb):
    """End at once; the burst at work is discarded."""

    action: Literal["cancel"]

    def carry_out(self, desk: Desk) -> Answer:
        _refuse_stream(desk)
        if desk.is_scanning:
            desk.daemon.request("idle")
            desk.daemon.control.cancel()
        return desk.reply(ScanReply)


class Once(Verb):
    """One burst; answered once its map is published."""

    place: ClassVar[Place] = "burst"
    action: Literal["once"]
    map: bool = Field(
        False, description="Have the fused messages follow the reply, each with its topic as attachment."
    )

    def carry_out(self, desk: Desk) -> Answer:
        _refuse_stream(desk)
        daemon, answer = desk.daemon, Future[Outcome]()
        mode = Scanning(daemon, asked=True) if desk.is_idle and not daemon.ending else None
        if mode is not None:
            mode.prepare()
        daemon.agenda.queue(lambda result: self._fused(desk, answer, result))
        if mode is not None:
            daemon.agenda.ask(lambda: mode)
        return answer

    def _fused(self, desk: Desk, answer: "Future[Outcome]", result: FusedMap | Exception) -> None:
        if isinstance(result, Exception):
            answer.set_exception(result)
        else:
            desk.daemon.emit(Delivery(lambda: answer.set_result(self._outcome(desk, result))))

    def _outcome(self, desk: Desk, result: FusedMap) -> Outcome:
        reply = desk.reply(ScanReply, report=result.report)
        return Outcome(reply, fused_messages(result) if self.map else ())


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
    (Start, Stop, Cancel, Once, Pause, Resume),
    ScanReply,
)
