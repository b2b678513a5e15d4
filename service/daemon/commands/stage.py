"""`cmd/stage`: what turns the camera."""

from typing import ClassVar, Literal

from pydantic import Field

from service.daemon.desk import Desk
from service.daemon.verb import Answer, Command, Outcome, Place, Reply, Verb, then
from service.errors import InvalidStateError, UnavailableError


class StageReply(Reply):
    """Where the stage is."""

    pan: float | None = Field(None, description="Radians, > 0 left, as it reports; none = not known.")
    tilt: float | None = Field(None, description="Radians, > 0 up, as it reports; none = not known.")
    uncertainty: str | None = Field(None, description="Why its position is not known; none = it is.")
    homing: str = Field(description="What `home` does.")
    pan_limits: tuple[float, float] = Field(description="Radians that it accepts.")
    tilt_limits: tuple[float, float] = Field(description="Radians that it accepts.")


class Get(Verb):
    """Where it reports to be, and its limits."""

    place: ClassVar[Place] = "pose"
    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return _reply(desk)


class Stop(Verb):
    """Halt at once, whatever it does, in every state; a scan or a stream is cancelled."""

    action: Literal["stop"]

    def carry_out(self, desk: Desk) -> Answer:
        daemon = desk.daemon
        was_idle = desk.is_idle
        daemon.control.halt()
        if not was_idle:
            daemon.control.cancel()  # once that is stopped which moves, the burst must not go on
            daemon.rest()
        try:
            halted = daemon.control.inbox.submit(lambda: _halt(desk), "pose")
        except UnavailableError:
            daemon.control.release()  # it has been stopped on the way all the same
            raise
        return then(halted, Outcome)


class Home(Verb):
    """Find the reference position and go to 0°, 0°. Asking for it is consent: nobody may be in the way."""

    place: ClassVar[Place] = "pose"
    action: Literal["home"]

    def carry_out(self, desk: Desk) -> Answer:
        daemon = desk.daemon
        if not (desk.is_idle or daemon.control.paused):
            raise InvalidStateError(f"{daemon.states.state}: stop, or pause, first")
        daemon.rig.motion.home()
        daemon.states.mend("stage")
        return _reply(desk)


def _halt(desk: Desk) -> StageReply:
    daemon = desk.daemon
    daemon.control.release()
    daemon.rig.motion.halt()
    return _reply(desk)


def _reply(desk: Desk) -> StageReply:
    stage = desk.daemon.rig.stage
    position = None if stage.needs_home else desk.daemon.rig.motion.position
    return desk.reply(
        StageReply,
        pan=None if position is None else position.pan,
        tilt=None if position is None else position.tilt,
        uncertainty=stage.uncertainty,
        homing=stage.homing,
        pan_limits=stage.limits.pan,
        tilt_limits=stage.limits.tilt,
    )


COMMAND = Command("cmd/stage", "What turns the camera.", (Get, Stop, Home), StageReply)
