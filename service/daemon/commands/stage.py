"""`cmd/stage`: what turns the camera."""

from typing import ClassVar, Literal

from pydantic import Field

from service.daemon.desk import Desk
from service.daemon.verb import Answer, Command, Place, Reply, Verb


class StageReply(Reply):
    """Where the stage is."""

    pan: float | None = Field(None, description="Radians, > 0 left, as it reports; none = not known.")
    tilt: float | None = Field(None, description="Radians, > 0 up, as it reports; none = not known.")
    pan_limits: tuple[float, float] = Field(description="Radians that it accepts.")
    tilt_limits: tuple[float, float] = Field(description="Radians that it accepts.")


class Get(Verb):
    """Where it reports to be, and its limits."""

    place: ClassVar[Place] = "pose"
    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return _reply(desk)


def _reply(desk: Desk) -> StageReply:
    stage = desk.daemon.rig.stage
    position = None if stage.needs_home else stage.position
    return desk.reply(
        StageReply,
        pan=None if position is None else position.pan,
        tilt=None if position is None else position.tilt,
        pan_limits=stage.limits.pan,
        tilt_limits=stage.limits.tilt,
    )


COMMAND = Command("cmd/stage", "What turns the camera.", (Get,), StageReply)
