"""The run: devices → frames → jobs → maps, as events to whoever takes them."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager

from drivers.frame import Frame
from drivers.recording import Recording
from drivers.settings import Capabilities
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.played import recording_of
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.daemon.advance import Advance
from service.daemon.agenda import Agenda
from service.daemon.disk import DiskWatch
from service.daemon.first_mode import first_mode
from service.daemon.fusing import Fusing
from service.daemon.heartbeat import Heartbeat
from service.daemon.last_resort import Wish
from service.daemon.ledger import Ledger
from service.daemon.logs import logged_events
from service.daemon.modes import Idle, Mode
from service.daemon.monitor import Monitor
from service.daemon.origin import Origin
from service.daemon.playing import Playing
from service.daemon.states import States
from service.daemon.succession import Succession
from service.daemon.supervision import Supervision
from service.daemon.systemd import READY, STOPPING, notify
from service.fusion.executor import Executor
from service.messages.events import Event, FrameCaptured, ScanProgressed
from service.messages.replay import ReplayState
from service.messages.status import CommandCounts
from service.sinks.bus import Bus

_LAST_JOBS = 1.5
"""Seconds that the jobs in work get when the service is told to stop: it shall end within five."""


class Daemon:
    """One run of the service; it knows nobody who takes its events.

    The thread that calls `run` owns the devices. It works in one mode until that ends, or until another is
    asked for.

    Args:
        configuration: what to do.
        rig: the configured devices, closed.
        bus: takes the events.
        executor: fuses; whoever made it closes it.
        once: one pass: a recording to its end, one burst of the plan, or one window of a stream. Nothing is
            dropped then: whoever is faster waits.

    Attributes:
        on_ready: called when all is made ready, before anything is captured.
    """

    def __init__(
        self,
        configuration: Configuration,
        rig: Rig,
        bus: Bus,
        executor: Executor,
        *,
        once: bool = False,
    ) -> None:
        self.configuration, self.rig, self.bus, self.once = configuration, rig, bus, once
        self.stop = Wish()
        self.control, self.agenda = Control(self.stop), Agenda()
        self.control.beat = rig.beat
        self.ledger = Ledger()
        self.states = States(self.emit)
        self.recording: Recording | None = None
        self.next_burst = 0
        self.grabber = Grabber(rig, configuration.camera.timeout, self.control, self._captured)
        self.fusing = Fusing(executor, self.emit, lossless=once)
        self.origin = Origin(lambda: self.configuration, self.fusing, self.emit)
        self._advance = Advance(lambda: self.origin.planned, lambda: self.fusing.backlog.unfinished)
        self.supervision = Supervision(self.states, self._is_live)
        self.mode: Mode | None = None
        self.lookouts: list[Callable[[], None]] = []
        self.on_ready: Callable[[], None] = lambda: None
        self.command_counts: Callable[[], CommandCounts] = CommandCounts
        self._is_shown = False

    @property
    def camera(self) -> Capabilities | None:
        """What gives the frames at present; None until it is open."""
        return self.origin.camera

    @property
    def is_opening(self) -> bool:
        """Whether the devices are not shown yet: they are being opened, or a scene is being rendered."""
        return not self._is_shown

    @property
    def replay(self) -> ReplayState:
        """Where a replay is."""
        mode = self.mode
        return mode.replay if isinstance(mode, Playing) else ReplayState(timestamp=self.rig.clock.now())

    @property
    def carries_pose(self) -> bool:
        """Whether frames bring their own angles, as a recording's do; the rig must be open."""
        return self.rig.camera.capabilities.carries_pose

    @property
    def is_replayed(self) -> bool:
        """Whether a recording is played, which comes to an end by itself."""
        return self.rig.camera.capabilities.source == "replay"

    @property
    def planned(self) -> int | None:
        """Frames of a whole burst: of the plan, or as a recording says; None = it does not."""
        if not self.carries_pose:
            return self.configuration.fusion.frames
        return None if self.recording is None else self.recording.planned

    def _is_live(self) -> bool:
        return self.camera is not None and self.camera.source != "replay"

    @property
    def ending(self) -> bool:
        """Whether the mode at work shall end, between two bursts or frames."""
        return self.stop.is_set() or self.agenda.next is not None

    def emit(self, event: Event) -> None:
        """Note an event and hand it to the sinks."""
        self.ledger.note(event)
        self.supervision.note(event)
        self.bus.emit(event)
        if (progress := self._advance.after(event)) is not None:
            self.bus.emit(ScanProgressed(progress))

    def rest(self) -> None:
        """Be idle after the burst, or the frame, at work; for any thread."""
        self.agenda.ask(Idle(self))
        self.control.inbox.wake()

    def ask(self, mode: Mode) -> "Future[None]":
        """As `rest`, for another mode that is ready; done when it has begun."""
        begun = self.agenda.ask(mode)
        self.control.inbox.wake()
        return begun

    def begin(self, mode: Mode) -> "Future[None]":
        """Have a mode begin next; for the thread that owns the devices. Done when it has begun.

        Raises:
            DriverError, ServiceError: it cannot be made ready; what was at work goes on.
        """
        mode.prepare()
        return self.agenda.ask(mode)

    def close(self) -> None:
        """End the process that fuses, whatever it does."""
        self.fusing.close()

    def run(self) -> None:
        """Work until a recording ends, one pass is done, or `stop` is set.

        Raises:
            DriverError: the devices cannot be opened, or a recording cannot be used.
            ServiceError: a plan out of reach, a fusion that cannot work, or not one map.
        """
        with ExitStack() as stack:
            stack.callback(self.close)
            stack.callback(self._refuse_all)
            stack.enter_context(self._open_rig())
            self.recording = recording_of(self.rig.camera)
            disk = stack.enter_context(DiskWatch(self.configuration.recording))
            monitor = Monitor(self.rig, self.grabber.counts, self, self.fusing.executor, self.bus, disk)
            mode = first_mode(self)
            # Neither status nor log may come once the sinks are closed.
            with logged_events(self.emit), Heartbeat(monitor.beat) as heartbeat:
                self.states.changed = self.control.changed = heartbeat.nudge
                self._announce()
                mode.prepare()
                self._wait_ready()
                self.on_ready()
                notify(READY)
                Succession(self).work(mode)
                self._finish()

    def _refuse_all(self) -> None:
        """Nobody serves any more: say so to all who wait, and to all who come."""
        self.control.inbox.close("the service ends")
        self.agenda.close("the service ends")

    def _announce(self) -> None:
        settings, recording = self.configuration, self.recording
        expected = settings.stream.window if settings.start == "stream" else settings.fusion.frames
        frames = recording.frame_count if recording is not None else expected if self.once else None
        self.origin.show(self.rig, self.rig.clock.now(), frames)
        self._is_shown = True

    def _wait_ready(self) -> None:
        for progress in self.fusing.waiting(self.stop):
            self.states.enter("starting", f"the fusion {progress}")

    def _finish(self) -> None:
        told = self.stop.is_set()
        self.states.enter("stopping", "told to stop" if told else "all is captured")
        notify(STOPPING)
        self.fusing.finish(_LAST_JOBS if told else None)
        if not told:
            self.fusing.require_map(self.ledger.failures)

    @contextmanager
    def _open_rig(self) -> Iterator[None]:
        self.rig.open()
        try:
            yield
        finally:
            if self.origin.rig is not None:
                self.origin.rig.close()
            self.rig.close()

    def _captured(self, frame: Frame) -> None:
        if self.mode is not None and self.states.state == "recovering":
            self.states.enter(self.mode.state, self.mode.reason)
        self.emit(FrameCaptured(frame, self.rig.calibration.mount))
