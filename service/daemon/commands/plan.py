"""`cmd/plan`: where the camera looks in the course of one burst."""

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from drivers.errors import DriverError
from service.config.sections import PlanSection
from service.daemon.desk import Desk
from service.daemon.modes import plan_of
from service.daemon.playing import Playing
from service.daemon.renewal import reconfigure
from service.daemon.verb import Answer, Command, Place, Reply, Verb


class PlanReply(Reply):
    """The plan."""

    plan: PlanSection = Field(description="What is in force.")
    poses: tuple[tuple[float, float], ...] | None = Field(
        None,
        description="Pan and tilt of each pose in turn, radians; null = frames bring their own, or no "
        "device is open.",
    )


class Get(Verb):
    """What is in force."""

    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return _reply(desk)


class Set(Verb, PlanSection):
    """Change some of it, from the next burst on; refused where a pose is out of the stage's reach."""

    place: ClassVar[Place] = "burst"
    action: Literal["set"]

    @model_validator(mode="after")
    def _nearest_is_nearer(self) -> Self:
        return self  # judged beside what is in force

    def carry_out(self, desk: Desk) -> Answer:
        daemon = desk.daemon
        reconfigure(daemon, plan=desk.changed(daemon.configuration.plan, self.given))
        return _reply(desk)


def _reply(desk: Desk) -> PlanReply:
    return desk.reply(PlanReply, plan=desk.daemon.configuration.plan, poses=_poses(desk))


def _poses(desk: Desk) -> tuple[tuple[float, float], ...] | None:
    daemon = desk.daemon
    try:
        if isinstance(daemon.mode, Playing) or daemon.carries_pose:
            return None
        plan = plan_of(daemon.configuration, daemon.rig, daemon.configuration.fusion.frames)
    except DriverError:  # lost, or not open yet
        return None
    return tuple((pose.pan, pose.tilt) for pose in plan.poses)


COMMAND = Command("cmd/plan", "Where the camera looks in the course of one burst.", (Get, Set), PlanReply)
