"""The service: camera and stage → bursts → fusion → publisher, recorders and pictures."""

import logging
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import radians
from pathlib import Path
from threading import Event

from drivers.frame import Frame
from drivers.messages import calibration_message, frame_messages
from drivers.poses import camera_rotation
from service.capture.burst import Burst
from service.capture.estimate import estimate_plan
from service.capture.loop import Bursts, Capture, CarriedBursts, Grabber, ScanBursts
from service.capture.plan import Plan, make_plan
from service.capture.played import recording_of, truth_of
from service.capture.rig import Rig
from service.config import Configuration
from service.errors import MotionError, ServiceError
from service.fusion.fusion import FusedBurst
from service.fusion.quality import judge
from service.fusion.summary import BurstSummary, RunSummary, describe, summarize
from service.fusion.worker import FusionWorker
from service.health.heartbeat import Heartbeat
from service.health.logs import published_log
from service.health.monitor import Monitor
from service.health.systemd import READY, STOPPING, notify
from service.output.outlets import open_outlets
from service.output.recording_head import head_of
from service.wire.messages import fused_messages, status_message

_HANDOVER = 30.0
"""Seconds that subscribers get at the end to take what was published."""

_LAST_FUSION = 5.0
"""Seconds that the bursts in work get when the service is told to stop: systemd allows 90."""

_REMEMBERED = 1000
"""Bursts of which a run keeps the summary: the service runs for weeks."""

_log = logging.getLogger(__name__)


class Watch:
    """Is told what happens; a progress display overrides what it shows. Called from several threads."""

    def started(self, daemon: "Daemon") -> None:
        """The devices are open."""

    def warming(self) -> None:
        """The fusion loads its kernels, or compiles them where this is their first run."""

    def captured(self, frame: Frame) -> None:
        """A frame belongs to a burst."""

    def burst(self, number: int) -> None:
        """That many bursts are complete."""

    def fused(self, burst: BurstSummary) -> None:
        """A map is finished and sent."""

    def failed(self, burst: int, reason: str) -> None:
        """A burst could not be fused."""


class Daemon:
    """One run of the service.

    Args:
        configuration: what to do.
        rig: the configured devices, closed.
        output: directory for `fused.mcap` and pictures, or None.
        once: one pass: a recording to its end, or one burst of the plan. Nothing is dropped then: whoever is
            faster waits.
        watch: is told what happens.
    """

    def __init__(
        self,
        configuration: Configuration,
        rig: Rig,
        *,
        output: Path | None = None,
        once: bool = False,
        watch: Watch | None = None,
    ) -> None:
        self.configuration, self.rig, self.output, self.once = configuration, rig, output, once
        self.stop = Event()
        self._watch = watch if watch is not None else Watch()
        self._fused: deque[BurstSummary] = deque(maxlen=_REMEMBERED)
        self._failures: list[str] = []
        self._grabber = Grabber(rig, configuration.camera.timeout, self.stop, self._captured)
        self._worker = FusionWorker(configuration.fusion, self._on_fused, self._on_failed, lossless=once)

    @property
    def carries_pose(self) -> bool:
        """Whether frames bring their own angles, as a recording's do; the rig must be open."""
        return self.rig.camera.capabilities.carries_pose

    def run(self) -> RunSummary:
        """Work until a recording ends, one pass is done, or `stop` is set; then hand everything over.

        Raises:
            DriverError: the devices cannot be opened, or a recording cannot be used.
            ServiceError: no session, no output, a plan out of reach, a dead worker, or not one map.
        """
        self._worker.start()  # takes seconds to warm up, in which the devices open
        with ExitStack() as stack:
            stack.callback(self._worker.close)
            stack.enter_context(self._open_rig())
            self._truth = truth_of(self.rig.camera, self.configuration.fusion.upsampling)
            head = head_of(self.configuration, self.rig, self._truth)
            self._outlets = stack.enter_context(
                open_outlets(self.configuration, self.output, head, self._truth, lossless=self.once)
            )
            self._monitor = Monitor(self.rig, self._grabber.counts, self._worker, self._outlets)
            began = time.monotonic()
            # Neither status nor log may come once the recorders are closed.
            with published_log(lambda message: self._outlets.send([message])), Heartbeat(self._beat):
                self._work()
            self._outlets.settle(_HANDOVER)
            return self._summary(time.monotonic() - began)

    def _work(self) -> None:
        """Capture and fuse until it is over."""
        capture = Capture(self._grabber, self._bursts(), self.configuration.plan.pause)
        self._watch.started(self)
        calibration = self.rig.calibration
        self._outlets.send([calibration_message(calibration, self.rig.clock.now())])
        camera_rotation(0.0, 0.0, calibration.mount)  # imports a good part of SciPy, once, before frames come
        self._watch.warming()
        self._worker.wait_ready(self.stop.is_set)
        notify(READY)
        self._monitor.state = "scanning"
        try:
            self._scan(capture)
        except MotionError as error:
            if self.once:
                raise
            self._stand_still(error)
        self._monitor.state = "stopping"
        notify(STOPPING)
        self._worker.drain(_LAST_FUSION if self.stop.is_set() else None)
        self._worker.close()
        if self._worker.counts.fused == 0 and not self.stop.is_set():
            raise ServiceError(f"no burst could be fused: {self._why_nothing()}")

    def _scan(self, capture: Capture) -> None:
        for burst in capture.run():
            self._outlets.send([calibration_message(burst.calibration, burst.reference.timestamp)])
            self._watch.burst(capture.counts.bursts)
            self._worker.submit(burst)
            if self.once and not self.carries_pose:
                break

    def _stand_still(self, reason: MotionError) -> None:
        """Capture nothing until stopped: what made the stage unsafe to move needs a person."""
        _log.error("%s", reason)
        self._grabber.counts.error = str(reason)
        self._monitor.state = "idle"
        self.stop.wait()

    @contextmanager
    def _open_rig(self) -> Iterator[None]:
        self.rig.open()
        try:
            yield
        finally:
            self.rig.close()

    def _bursts(self) -> Bursts:
        """How frames become bursts: as they say themselves, else by the plan."""
        settings = self.configuration
        if self.carries_pose:
            return CarriedBursts(self._grabber, settings.fusion.frames)
        limits = self.rig.stage.limits
        only_pan = limits.tilt[0] == limits.tilt[1]
        plan = make_plan(
            settings.plan.model_copy(update={"axes": "pan"}) if only_pan else settings.plan,
            settings.fusion.frames,
            self.rig.calibration.intrinsics,
            upsampling=settings.fusion.upsampling,
            resolution=radians(settings.stage.resolution) or self.rig.stage.resolution,
            still=only_pan and limits.pan[0] == limits.pan[1],
        )
        plan.check(limits)
        if plan.moves:
            self._announce(plan)
        return ScanBursts(self._grabber, plan, settings.stage.settle, settings.stage.timeout)

    def _announce(self, plan: Plan) -> None:
        settings = self.configuration
        expected = estimate_plan(
            plan,
            self.rig.calibration,
            settings.fusion.upsampling,
            settings.plan.nearest,
            settings.plan.farthest,
        )
        _log.info("plan: %s", expected)
        for warning in expected.warnings:
            _log.warning("plan: %s", warning)

    def _captured(self, frame: Frame) -> None:
        self._outlets.send(frame_messages(frame, self.rig.calibration.mount))
        self._monitor.frame()
        self._watch.captured(frame)

    def _on_fused(self, result: FusedBurst) -> None:
        self._outlets.send_fused(result, fused_messages(result))
        self._monitor.map(result.report.latency)
        burst = summarize(result, judge(result, self._truth))
        self._fused.append(burst)
        _log.info("%s", describe(burst))
        self._watch.fused(burst)

    def _on_failed(self, burst: Burst, reason: str) -> None:
        _log.error("burst %d could not be fused: %s", burst.id, reason)
        self._failures.append(f"burst {burst.id} not fused: {reason}")
        del self._failures[:-_REMEMBERED]
        self._watch.failed(burst.id, reason)

    def _beat(self) -> None:
        status = self._monitor.status()
        self._outlets.send([status_message(status, status.timestamp)])
        self._monitor.tell_systemd(status)

    def _why_nothing(self) -> str:
        return self._failures[-1] if self._failures else "there was none"

    def _summary(self, seconds: float) -> RunSummary:
        known, counts = self.rig.camera.capabilities, self._grabber.counts
        return RunSummary(
            source=known.source,
            model=known.model,
            frames=counts.frames,
            stale=counts.stale,
            dropped_frames=counts.dropped,
            bursts=counts.bursts,
            fused=tuple(self._fused),
            maps=self._worker.counts.fused,
            published=self._outlets.published,
            files=tuple(str(path) for path in self._outlets.files),
            seconds=seconds,
            lost=tuple(self._lost()),
        )

    def _lost(self) -> list[str]:
        recording = recording_of(self.rig.camera)
        said = [f"{recording.path}: {recording.damage}"] if recording is not None and recording.damage else []
        said += self._failures
        if self._worker.counts.dropped:
            said.append(
                f"{self._worker.counts.dropped} bursts not fused: the fusion was slower than the capture"
            )
        if self._grabber.counts.dropped and not self.carries_pose:
            said.append(f"{self._grabber.counts.dropped} frames dropped by the camera")
        return said + self._outlets.lost
