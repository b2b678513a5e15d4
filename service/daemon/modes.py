"""What the service does: nothing, bursts by a plan, or a map for every frame."""

from __future__ import annotations

import logging
import time
from math import radians
from typing import TYPE_CHECKING, Protocol

from drivers.errors import DeviceLostError, OperationError
from service.capture.carried import CarriedBursts
from service.capture.pace import Pace
from service.capture.resumption import BegunBurst, begun_burst
from service.capture.rig import Rig
from service.capture.scan import ScanBursts
from service.capture.series import Capture
from service.capture.stream import CarriedFrames, SweptFrames
from service.config.sections import Configuration
from service.daemon.recovery import Recovery
from service.errors import UnavailableError
from service.fusion.job import BurstJob, FrameJob
from service.messages.burst import Burst, check_frame
from service.messages.events import BurstCaptured
from service.messages.map import FusedMap
from service.messages.status import State
from service.planning.estimate import estimate_plan
from service.planning.plan import Plan, make_plan

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

_NEWEST = 1
"""Frames of a stream that wait: when the solver is slower, the newest frame wins."""

_log = logging.getLogger(__name__)


class Mode(Protocol):
    """One way to work."""

    state: State

    @property
    def reason(self) -> str:
        """Why it is in that state."""

    @property
    def rig(self) -> Rig:
        """What gives the frames."""

    def prepare(self) -> None:
        """Make ready, before anything moves; raises where it cannot be done."""

    def run(self) -> None:
        """Work until that is over, or something else is asked for."""

    def anew(self) -> Mode:
        """The same from its beginning, with what is configured then."""


class Idle:
    """Devices are open, nothing is captured."""

    state: State = "idle"

    def __init__(self, daemon: Daemon, reason: str = "waiting to be asked") -> None:
        self._daemon, self.rig, self.reason = daemon, daemon.rig, reason

    def prepare(self) -> None: ...

    def run(self) -> None:
        daemon = self._daemon
        recover = Recovery(daemon, self, proven=False)
        while not daemon.ending:
            try:
                if not daemon.rig.is_open:  # something was asked for while a device was lost
                    raise DeviceLostError("a device is still lost")
                daemon.control.rest()
                daemon.control.renew()  # a cancellation that came too late
            except OperationError as error:
                recover(error)

    def anew(self) -> Idle:
        return Idle(self._daemon)


class Scanning:
    """Burst after burst, each fused while the next is captured.

    Args:
        daemon: at work.
        asked: only as many bursts as somebody waits for.
        resumes: whether a burst that was interrupted before is taken up again.
    """

    state: State = "scanning"

    def __init__(self, daemon: Daemon, *, asked: bool = False, resumes: bool = False) -> None:
        self._daemon, self.rig, self.asked, self._resumes = daemon, daemon.rig, asked, resumes
        self._pace = Pace()
        self.reason = "bursts by the plan"
        if daemon.carries_pose:
            self.reason = "bursts as recorded" if daemon.is_replayed else "bursts of another rig"
        if asked:
            self.reason = "a burst that was asked for"

    def prepare(self) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        if daemon.carries_pose:
            self._source: CarriedBursts | ScanBursts = CarriedBursts(
                daemon.grabber, settings.fusion.frames, daemon.planned
            )
        else:
            plan = planned(settings, daemon.rig, settings.fusion.frames)
            begun = self._begun(len(plan)) if self._resumes else None
            if begun is not None:
                daemon.next_burst = begun.number
            self._source = ScanBursts(
                daemon.grabber,
                plan,
                settings.stage.settle,
                settings.stage.timeout,
                () if begun is None else begun.frames,
            )

    def run(self) -> None:
        daemon = self._daemon
        capture = Capture(
            daemon.grabber,
            self._source,
            Recovery(daemon, self),
            lambda: daemon.ending,
            pause=self._pause,
            hurried=lambda: daemon.agenda.awaited,
            first=daemon.next_burst,
        )
        try:
            for number, burst in enumerate(capture.run(), 1):
                self._hand_over(burst, number, time.monotonic() - capture.began)
                if daemon.once and not daemon.is_replayed:
                    return
                if self.asked and not daemon.agenda.awaited:
                    daemon.rest()
        finally:
            daemon.next_burst = capture.number

    def anew(self) -> Scanning:
        return Scanning(self._daemon, asked=self.asked)

    def _begun(self, poses: int) -> BegunBurst | None:
        daemon = self._daemon
        return begun_burst(daemon.configuration, daemon.rig, poses)

    def _pause(self, elapsed: float) -> float:
        """Seconds left until the next burst; frames that bring their own angles come when they come."""
        left = self._daemon.configuration.plan.pause - elapsed
        return left if self._daemon.carries_pose else max(left, self._pace.wait())

    def _hand_over(self, burst: Burst, number: int, seconds: float) -> None:
        daemon, fusion = self._daemon, self._daemon.configuration.fusion
        done = daemon.agenda.turn()
        daemon.emit(BurstCaptured(burst, number))
        job = BurstJob(burst, fusion, awaited=done is not None)
        self._pace.captured(seconds, fusion)

        def finished(outcome: FusedMap | Exception) -> None:
            if isinstance(outcome, UnavailableError):
                self._pace.dropped()
            else:
                self._pace.fused()
            if done is not None:
                done(outcome)

        daemon.fusing.backlog.put(job, fusion.backlog, daemon.stop.is_set, finished)


class Streaming:
    """A map for every frame, of a window of the last ones."""

    state: State = "streaming"

    def __init__(self, daemon: Daemon) -> None:
        self._daemon, self.rig = daemon, daemon.rig
        self.reason = f"a map for every frame, of the last {daemon.configuration.stream.window}"

    def prepare(self) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        self._number = daemon.fusing.next_stream()
        if daemon.carries_pose:
            self._source: CarriedFrames | SweptFrames = CarriedFrames(daemon.grabber)
        else:
            plan = planned(settings, daemon.rig, settings.stream.window)
            poses = ScanBursts(daemon.grabber, plan, settings.stage.settle, settings.stage.timeout)
            self._source = SweptFrames(poses, plan)

    def run(self) -> None:
        daemon, settings = self._daemon, self._daemon.configuration
        capture = Capture(daemon.grabber, self._source, Recovery(daemon, self), lambda: daemon.ending)
        for number, frame in enumerate(capture.run()):
            calibration = daemon.rig.calibration
            check_frame(frame, calibration)
            window, exposed = settings.stream.window, daemon.rig.exposed(frame)
            job = FrameJob(frame, calibration, settings.fusion, window, self._number, number, exposed)
            daemon.fusing.backlog.put(job, _NEWEST, daemon.stop.is_set)
            if daemon.once and not daemon.is_replayed and number + 1 == settings.stream.window:
                return

    def anew(self) -> Streaming:
        return Streaming(self._daemon)


def planned(settings: Configuration, rig: Rig, poses: int) -> Plan:
    """The configured plan for the stage at hand; what to expect of it is logged.

    Raises:
        PlanError: a pose out of reach.
    """
    plan = plan_of(settings, rig, poses)
    plan.check(rig.stage.limits)
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


def plan_of(settings: Configuration, rig: Rig, poses: int) -> Plan:
    """The configured plan for the stage at hand, within its reach or not; touches no device."""
    limits = rig.stage.limits
    only_pan = limits.tilt[0] == limits.tilt[1]
    return make_plan(
        settings.plan.model_copy(update={"axes": "pan"}) if only_pan else settings.plan,
        poses,
        rig.calibration.intrinsics,
        upsampling=settings.fusion.upsampling,
        resolution=radians(settings.stage.resolution) or rig.stage.resolution,
        still=only_pan and limits.pan[0] == limits.pan[1],
    )
