"""`cmd/settings`: what the camera is set to."""

from typing import ClassVar, Literal

from pydantic import Field

from drivers.settings import CameraSettings
from service.daemon.desk import Desk
from service.daemon.renewal import reconfigure
from service.daemon.verb import Answer, Command, Place, Reply, Verb


class SettingsReply(Reply):
    """The camera's settings."""

    settings: CameraSettings = Field(description="What is in force.")


class Get(Verb):
    """What is in force."""

    changes: ClassVar[bool] = False
    action: Literal["get"]

    def carry_out(self, desk: Desk) -> Answer:
        return desk.reply(SettingsReply, settings=desk.daemon.rig.camera.settings)


class Set(Verb, CameraSettings):
    """Set some of the camera's settings, from the next burst on."""

    place: ClassVar[Place] = "burst"
    action: Literal["set"]

    def carry_out(self, desk: Desk) -> Answer:
        daemon, rig = desk.daemon, desk.daemon.rig
        rig.apply(rig.camera.settings.model_copy(update=self.given))
        used = {"settings": rig.camera.settings}
        reconfigure(daemon, camera=daemon.configuration.camera.model_copy(update=used))
        return desk.reply(SettingsReply, settings=rig.camera.settings)


COMMAND = Command("cmd/settings", "What the camera is set to.", (Get, Set), SettingsReply)
