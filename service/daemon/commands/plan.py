"""`cmd/plan`: where the camera looks in the course of one burst."""

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from service.config.sections import PlanSection
from service.daemon.desk import Desk
from service.daemon.renewal import reconfigure
from service.daemon.verb import Answer, Command, Place, Reply, Verb


class PlanReply(Reply):
    """The plan."""

    plan: PlanSection = Field(description="What is in force.")


class Get(Verb):
    """What is in force."""

    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return desk.reply(PlanReply, plan=desk.daemon.configuration.plan)


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
        return desk.reply(PlanReply, plan=daemon.configuration.plan)


COMMAND = Command("cmd/plan", "Where the camera looks in the course of one burst.", (Get, Set), PlanReply)
