"""What the service does: nothing, bursts by a plan, or a map for every frame."""

from __future__ import annotations

import logging
from collections.abc import Callable
from math import radians
from typing import TYPE_CHECKING, Protocol

from service.capture.loop import Capture, CarriedBursts, ScanBursts
from service.capture.rig import Rig
from service.capture.stream import CarriedFrames, SweptFrames
from service.config.sections import Configuration
from service.fusion.job import BurstJob, FrameJob
from service.messages.burst import check_frame
from service.messages.events import BurstCaptured
from service.messages.status import State
from service.planning.estimate import estimate_plan
from service.planning.plan import Plan, make_plan

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

_LOOK = 0.1
"""Seconds between two looks whether something else is asked for."""

_NEWEST = 1
"""Frames of a stream that wait: when the solver is slower, the newest frame wins."""

_log = logging.getLogger(__name__)

Ending = Callable[[], bool]
"""Whether the mode shall end, between two bursts or frames."""


class Mode(Protocol):
    """One way to work."""

    state: State
    reason: str

    def prepare(self) -> None:
        """Make ready, before anything moves; raises where it cannot be done."""

    def run(self, ending: Ending) -> None:
        """Work until that is over, or `ending` becomes true."""


class Idle:
    """Devices are open, nothing is captured."""

    state: State = "idle"

    def __init__(self, rig: Rig, reason: str = "waiting to be asked") -> None:
        self._rig, self.reason = rig, reason

    def prepare(self) -> None: ...

    def run(self, ending: Ending) -> None:
        while not ending():
            self._rig.wait(_LOOK, ending)


class Scanning:
    """Burst after burst, each fused while the next is captured."""

    state: State = "scanning"

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self.reason = "bursts as recorded" if daemon.carries_pose else "bursts by the plan"

    def prepare(self) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        if daemon.carries_pose:
            self._source: CarriedBursts | ScanBursts = CarriedBursts(
                daemon.grabber, settings.fusion.frames, daemon.planned
            )
        else:
            plan = planned(settings, daemon.rig, settings.fusion.frames)
            self._source = ScanBursts(daemon.grabber, plan, settings.stage.settle, settings.stage.timeout)

    def run(self, ending: Ending) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        capture = Capture(daemon.grabber, self._source, settings.plan.pause, daemon.recovering(self))
        for number, burst in enumerate(capture.run(), 1):
            daemon.emit(BurstCaptured(burst, number))
            daemon.backlog.put(BurstJob(burst, settings.fusion), settings.fusion.backlog, daemon.stop.is_set)
            if ending() or (daemon.once and not daemon.carries_pose):
                return


class Streaming:
    """A map for every frame, of a window of the last ones."""

    state: State = "streaming"

    def __init__(self, daemon: Daemon, number: int) -> None:
        self._daemon, self._number = daemon, number
        self.reason = f"a map for every frame, of the last {daemon.configuration.stream.window}"

    def prepare(self) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        if daemon.carries_pose:
            self._source: CarriedFrames | SweptFrames = CarriedFrames(daemon.grabber)
        else:
            plan = planned(settings, daemon.rig, settings.stream.window)
            poses = ScanBursts(daemon.grabber, plan, settings.stage.settle, settings.stage.timeout)
            self._source = SweptFrames(poses, plan)

    def run(self, ending: Ending) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        capture = Capture(daemon.grabber, self._source, recovering=daemon.recovering(self))
        for number, frame in enumerate(capture.run()):
            calibration = daemon.rig.calibration
            check_frame(frame, calibration)
            job = FrameJob(frame, calibration, settings.fusion, settings.stream.window, self._number, number)
            daemon.backlog.put(job, _NEWEST, daemon.stop.is_set)
            enough = daemon.once and not daemon.carries_pose and number + 1 == settings.stream.window
            if ending() or enough:
                return


def planned(settings: Configuration, rig: Rig, poses: int) -> Plan:
    """The configured plan for the stage at hand; what to expect of it is logged.

    Raises:
        PlanError: a pose out of reach.
    """
    limits = rig.stage.limits
    only_pan = limits.tilt[0] == limits.tilt[1]
    plan = make_plan(
        settings.plan.model_copy(update={"axes": "pan"}) if only_pan else settings.plan,
        poses,
        rig.calibration.intrinsics,
        upsampling=settings.fusion.upsampling,
        resolution=radians(settings.stage.resolution) or rig.stage.resolution,
        still=only_pan and limits.pan[0] == limits.pan[1],
    )
    plan.check(limits)
    if plan.moves:
        expected = estimate_plan(
            plan,
            rig.calibration,
            settings.fusion.upsampling,
            settings.plan.nearest,
            settings.plan.farthest,
        )
        _log.info("plan: %s", expected)
        for warning in expected.warnings:
            _log.warning("plan: %s", warning)
    return plan
