"""What a service begins with, as configured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from service.capture.played import replayed
from service.capture.player import Player
from service.daemon.modes import Idle, Mode, Scanning, Streaming
from service.daemon.playing import Playing

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon


def first_mode(daemon: Daemon) -> Mode:
    """Of a daemon whose rig is open: a recording that stands for the camera can be commanded as one."""
    configuration, rig = daemon.configuration, daemon.rig
    if configuration.start == "idle":
        return Idle(daemon)
    camera = None if daemon.once else replayed(rig.camera)
    if camera is None:
        resumes = configuration.recording.enabled and not daemon.once
        return Streaming(daemon) if configuration.start == "stream" else Scanning(daemon, resumes=resumes)
    player = Player(
        camera.reel,
        configuration.fusion.frames,
        speed=camera.speed,
        loop=camera.loops,
        playing=True,
        calibration=rig.replacement,
    )
    return Playing(daemon, rig, player, camera.recording.path.name, configuration.start, ends=True)
