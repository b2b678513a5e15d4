"""`cmd/stream`: a map for every frame, of the last ones."""

from typing import ClassVar, Literal

from pydantic import Field

from service.config.sections import StreamSection
from service.daemon.desk import Desk
from service.daemon.modes import Streaming
from service.daemon.verb import Answer, Command, Outcome, Place, Reply, Verb, then
from service.errors import InvalidStateError


class StreamReply(Reply):
    """Where the stream is."""

    stream: StreamSection = Field(description="What is in force.")


class Start(Verb, StreamSection):
    """Stream; a scan at work ends after its burst, and a stream with another window begins anew."""

    place: ClassVar[Place] = "burst"
    action: Literal["start"]

    def carry_out(self, desk: Desk) -> Answer:
        daemon = desk.daemon
        stream = desk.changed(daemon.configuration.stream, self.given)
        if desk.is_streaming and not daemon.ending and stream == daemon.configuration.stream:
            return _reply(desk)
        before = daemon.configuration
        daemon.configuration = before.model_copy(update={"stream": stream})
        try:
            begun = daemon.begin(Streaming(daemon))
        except BaseException:
            daemon.configuration = before
            raise
        return then(begun, lambda _: Outcome(_reply(desk)))


class Stop(Verb):
    """End after the frame at work; answered at once."""

    action: Literal["stop"]

    def carry_out(self, desk: Desk) -> Answer:
        if desk.is_scanning:
            raise InvalidStateError("scanning: end the scan with cmd/scan stop")
        if desk.is_streaming:
            desk.daemon.rest()
        return _reply(desk)


def _reply(desk: Desk) -> StreamReply:
    return desk.reply(StreamReply, stream=desk.daemon.configuration.stream)


COMMAND = Command("cmd/stream", "A map for every frame, of the last ones.", (Start, Stop), StreamReply)
