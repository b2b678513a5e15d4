"""The run: devices → frames → jobs → maps, as events to whoever takes them."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Event as Flag
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from drivers.poses import camera_rotation
from service.capture.head import head_of
from service.capture.loop import Grabber
from service.capture.played import recording_of, truth_of
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.daemon.heartbeat import Heartbeat
from service.daemon.ledger import Ledger
from service.daemon.logs import logged_events
from service.daemon.modes import Idle, Mode, Scanning, Streaming
from service.daemon.monitor import Monitor
from service.daemon.states import States
from service.daemon.systemd import READY, STOPPING, notify
from service.errors import MotionError, ServiceError
from service.fusion.backlog import Backlog
from service.fusion.job import Job
from service.fusion.local import LocalExecutor
from service.messages.events import DevicesOpened, Event, FrameCaptured, FusionFailed, MapFused
from service.messages.map import FusedMap
from service.sinks.bus import Bus

_LAST_JOBS = 2.0
"""Seconds that the jobs in work get when the service is told to stop: it shall end within five."""

_log = logging.getLogger(__name__)

ModeName = Literal["idle", "scan", "stream"]


class Daemon:
    """One run of the service; it knows nobody who takes its events.

    The thread that calls `run` owns the devices. It works in one mode until that ends, or until another is
    asked for.

    Args:
        configuration: what to do.
        rig: the configured devices, closed.
        bus: takes the events.
        once: one pass: a recording to its end, one burst of the plan, or one window of a stream. Nothing is
            dropped then: whoever is faster waits.
    """

    def __init__(self, configuration: Configuration, rig: Rig, bus: Bus, *, once: bool = False) -> None:
        self.configuration, self.rig, self.once = configuration, rig, once
        self.stop = Flag()
        self._changing = Flag()
        self.ledger = Ledger()
        self.states = States(self.emit)
        self._bus = bus
        self._wanted: ModeName = configuration.start
        self._streams = 0
        self._grid_moved = False
        self.grabber = Grabber(rig, configuration.camera.timeout, self.stop, self._captured)
        self._executor = LocalExecutor(
            configuration.fusion, configuration.stream.window if configuration.start == "stream" else None
        )
        self.backlog = Backlog(self._executor, self._fused, self._failed, lossless=once)
        self._truth: NDArray[np.float32] | None = None

    @property
    def carries_pose(self) -> bool:
        """Whether frames bring their own angles, as a recording's do; the rig must be open."""
        return self.rig.camera.capabilities.carries_pose

    @property
    def planned(self) -> int | None:
        """Frames of a whole burst: of the plan, or as a recording says; None = it does not."""
        if not self.carries_pose:
            return self.configuration.fusion.frames
        return None if self.recording is None else self.recording.planned

    @property
    def fusion_pid(self) -> int | None:
        """Of the process that fuses."""
        return self._executor.pid

    def emit(self, event: Event) -> None:
        """Note an event and hand it to the sinks."""
        self.ledger.note(event)
        self._bus.emit(event)

    def request(self, mode: ModeName) -> None:
        """Ask for another mode; it begins after the burst, or the frame, at work."""
        self._wanted = mode
        self._changing.set()

    def close(self) -> None:
        """End the process that fuses, whatever it does."""
        self._executor.close()

    def run(self) -> None:
        """Work until a recording ends, one pass is done, or `stop` is set.

        Raises:
            DriverError: the devices cannot be opened, or a recording cannot be used.
            ServiceError: a plan out of reach, a fusion that cannot work, or not one map.
        """
        with ExitStack() as stack:
            stack.callback(self.close)
            stack.enter_context(self._open_rig())
            self.camera = self.rig.camera.capabilities
            self.recording = recording_of(self.rig.camera)
            self._truth = truth_of(self.rig.camera, self.configuration.fusion.upsampling)
            monitor = Monitor(self.rig, self.grabber.counts, self, self._executor, self._bus)
            mode = self._mode()
            # Neither status nor log may come once the sinks are closed.
            with logged_events(self.emit), Heartbeat(monitor.beat):
                self._announce()
                mode.prepare()
                self._wait_ready()
                notify(READY)
                self._work(mode)
                self._finish()

    def _work(self, mode: Mode) -> None:
        """One mode after the other, as they are asked for."""
        while not self.stop.is_set():
            self.states.enter(mode.state, mode.reason)
            try:
                mode.run(self._ending)
            except MotionError as error:
                if self.once:
                    raise
                mode = self._standing_still(error)
                continue
            if not self._changing.is_set():
                return
            self._changing.clear()
            self.states.mend("stage")
            mode = self._mode()
            mode.prepare()

    def _standing_still(self, error: MotionError) -> Mode:
        """Nothing moves any more: what made the stage unsafe needs a person, who starts it again."""
        _log.error("%s", error)
        self.grabber.counts.error = str(error)
        self.states.degrade("stage", str(error), "look at the stage, then start again")
        return Idle(self.rig, str(error))

    def _ending(self) -> bool:
        return self.stop.is_set() or self._changing.is_set()

    def _mode(self) -> Mode:
        if self._wanted == "idle":
            return Idle(self.rig)
        if self._wanted == "stream":
            self._streams += 1
            return Streaming(self, self._streams)
        return Scanning(self)

    def _announce(self) -> None:
        known, recording = self.camera, self.recording
        settings = self.configuration
        expected = settings.stream.window if self._wanted == "stream" else settings.fusion.frames
        frames = recording.frame_count if recording is not None else expected if self.once else None
        calibration = self.rig.calibration
        self.emit(
            DevicesOpened(
                model=known.model,
                source=known.source,
                calibration=calibration,
                frames=frames,
                timestamp=self.rig.clock.now(),
                head=head_of(settings, self.rig, self._truth, self.planned),
            )
        )
        camera_rotation(0.0, 0.0, calibration.mount)  # imports a good part of SciPy, once, before frames come

    def _wait_ready(self) -> None:
        """Wait until the kernels are compiled; raises `WorkerError` where the fusion was given up."""
        while not self.stop.is_set():
            self.states.enter("starting", f"the fusion {self._executor.progress}")
            try:
                self._executor.ready.result(timeout=0.2)
                return
            except TimeoutError:
                continue

    def _finish(self) -> None:
        self.states.enter("stopping", "told to stop" if self.stop.is_set() else "all is captured")
        notify(STOPPING)
        if not self.backlog.drain(_LAST_JOBS if self.stop.is_set() else None):
            self.backlog.clear()
        if self.ledger.fused == 0 and not self.stop.is_set():
            why = self.ledger.failures[-1] if self.ledger.failures else "there was none"
            raise ServiceError(f"no burst could be fused: {why}")

    @contextmanager
    def _open_rig(self) -> Iterator[None]:
        self.rig.open()
        try:
            yield
        finally:
            self.rig.close()

    def recovering(self, mode: Mode) -> Callable[[str | None], None]:
        """Told of a device that is lost, and of its return."""

        def tell(reason: str | None) -> None:
            if reason is None:
                self.states.enter(mode.state, mode.reason)
            else:
                self.states.enter("recovering", reason)

        return tell

    def _captured(self, frame: Frame) -> None:
        self.emit(FrameCaptured(frame, self.rig.calibration.mount))

    def _fused(self, result: FusedMap) -> None:
        # The truth is that of the first view: a stream whose grid has moved has none.
        self._grid_moved = self._grid_moved or bool(result.report.notes)
        self.emit(MapFused(result, None if self._grid_moved else self._truth))

    def _failed(self, job: Job, error: Exception) -> None:
        _log.error("number %d could not be fused: %s", job.number, error)
        self.emit(FusionFailed(job.number, str(error)))
