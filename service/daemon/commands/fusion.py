"""`cmd/fusion`: how frames become one map."""

from typing import ClassVar, Literal

from pydantic import Field

from service.config.sections import FusionSettings
from service.daemon.desk import Desk
from service.daemon.renewal import reconfigure
from service.daemon.verb import Answer, Command, Place, Reply, Verb


class FusionReply(Reply):
    """How frames are fused."""

    fusion: FusionSettings = Field(description="What is in force.")


class Get(Verb):
    """What is in force."""

    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return desk.reply(FusionReply, fusion=desk.daemon.configuration.fusion)


class Set(Verb, FusionSettings):
    """Change some of it, from the next burst on; a stream begins anew."""

    place: ClassVar[Place] = "burst"
    action: Literal["set"]

    def carry_out(self, desk: Desk) -> Answer:
        daemon = desk.daemon
        reconfigure(daemon, fusion=desk.changed(daemon.configuration.fusion, self.given))
        return desk.reply(FusionReply, fusion=daemon.configuration.fusion)


COMMAND = Command("cmd/fusion", "How frames become one map.", (Get, Set), FusionReply)
