"""A run with all that the configuration asks for: session, sinks, daemon; and what came of it."""

import logging
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path

import zenoh

from service.capture.rig import Rig
from service.config.sections import Configuration
from service.daemon.commanded import commanded
from service.daemon.daemon import Daemon
from service.daemon.last_resort import last_resort
from service.daemon.namesakes import Namesakes
from service.daemon.network import Network
from service.daemon.page import kept_page
from service.daemon.recording import begin_recorder
from service.files import made_directory
from service.fusion.configured import configured_executor
from service.fusion.executor import Executor
from service.leaving import within
from service.messages.summary import BurstSummary, RunSummary
from service.messages.viewing import Extras
from service.sinks.bus import Bus
from service.sinks.configured import configured_sinks
from service.sinks.file_series import FileSeries
from service.sinks.foxglove import Foxglove
from service.sinks.foxglove_replay import Ask
from service.sinks.metrics import Metrics
from service.sinks.pictures import Pictures
from service.sinks.publisher import PUBLISHER, Publisher
from service.sinks.recorder import Recorder, order_of
from service.sinks.ros import ros_sink
from service.sinks.sink import Sink
from service.sinks.summaries import Summaries
from service.wire.asking import Asking
from service.wire.links import Links
from service.wire.session import open_session

FUSED_FILE = "fused.mcap"

_HANDOVER = 30.0
"""Seconds that the sinks get for what waits, after a whole run."""

_DEVICES, _OPENING, _SINKS = 2.5, 1.5, 3.6
"""Seconds after the wish to stop by which the devices have to be closed (where they are still being opened
nothing has been captured), and by which the sinks have to be: the session takes up to a second more, and all
shall end within five."""

_PROCESS = 0.3
"""Seconds in which the fusion's process is gone; one that is stopped by the kernel is left to it."""

_log = logging.getLogger(__name__)

_REPLAY_TIMEOUT = 2.0
"""Seconds that a viewer's playback control may take."""

SinkMakers = Mapping[str, Callable[[], Sink]]


def run_service(
    configuration: Configuration,
    rig: Rig,
    *,
    output: Path | None = None,
    once: bool = False,
    sinks: SinkMakers | None = None,
    executor: Executor | None = None,
    started: Callable[[Daemon], None] = lambda _: None,
    abandoned: Callable[[Sequence[str]], None] | None = None,
) -> RunSummary:
    """Run the service until it is over, and hand everything over.

    Args:
        configuration: what to do.
        rig: the configured devices, closed.
        output: directory for `fused.mcap` and pictures, or None.
        once: one pass, in which nothing is dropped.
        sinks: more that take the events, by name.
        executor: fuses; None = one of its own, which is closed in the end.
        started: called with the daemon before it runs, so that it can be stopped.
        abandoned: ends the process; called with what was lost, in another thread, where a device does not let
            go though the service was told to stop. None = it is waited for.

    Raises:
        ConfigurationError: a sink that cannot be used.
        SessionError: no Zenoh session.
        OutputError: the output directory cannot be made, or the port for metrics is taken.
        DriverError, ServiceError: as `Daemon.run`; nothing is left in `output` then.
        KeyboardInterrupt: one pass was told to stop before its first map; the same.
    """
    began = time.monotonic()
    summaries: deque[BurstSummary] = deque(maxlen=1000)
    makers = {**configured_sinks(configuration.sinks), **(sinks or {})}
    with ExitStack() as stack:
        if executor is None:
            executor = stack.enter_context(configured_executor(configuration))
        session = stack.enter_context(open_session(file=configuration.zenoh.config, lossless=once))
        if output is not None:
            stack.enter_context(made_directory(output))
        bus = stack.enter_context(Bus(lossless=once))
        daemon = Daemon(configuration, rig, bus, executor, once=once)
        bus.add("summaries", lambda: Summaries(summaries))
        daemon.lookouts.append(Network(Links(session, configuration.zenoh.config), daemon.states).look)
        daemon.lookouts.append(Namesakes(session, configuration.zenoh.prefix, daemon.states).look)
        bus.add(PUBLISHER, lambda: _publisher(configuration, session, once))
        begin_recorder(bus, configuration.recording, order_of(configuration.recording).wish)
        if configuration.metrics.enabled:
            bus.add("metrics", lambda: Metrics(Metrics.Options(port=configuration.metrics.port)))
        if configuration.ros2.enabled:
            bus.add("ros2", ros_sink(configuration.ros2, configuration.zenoh.config))
        if configuration.foxglove.enabled:
            bus.add("foxglove", lambda: Foxglove(configuration.foxglove, _replaying(configuration, session)))
        for name, make in (*_outputs(configuration, output, once).items(), *makers.items()):
            bus.add(name, make)
        stack.enter_context(commanded(daemon, session))
        if configuration.web.enabled and not once:
            stack.enter_context(kept_page(configuration, daemon.states))
        started(daemon)

        def hand_over() -> None:
            assert abandoned is not None
            if daemon.is_opening:
                _log.info("told to stop before the devices were ready")
            else:
                _log.error("a device does not let go: the service ends without it")
            bus.close(_SINKS - daemon.stop.seconds, discard=once and daemon.ledger.fused == 0, hurry=True)
            within(_PROCESS, executor.close, "closing the fusion")
            abandoned(_lost(daemon, bus))

        def patience() -> float:
            return _OPENING if daemon.is_opening else _DEVICES

        with nullcontext() if abandoned is None else last_resort(daemon.stop, patience, hand_over):
            daemon.run()
        if once and daemon.stop.is_set() and daemon.ledger.fused == 0:
            raise KeyboardInterrupt  # there is nothing to hand over
        publisher = bus.sink(PUBLISHER)
        told = daemon.stop.is_set()
        bus.close(_SINKS - daemon.stop.seconds if told else _HANDOVER, hurry=told)
        published = publisher.published if isinstance(publisher, Publisher) else 0
        return _summary(daemon, bus, summaries, published, time.monotonic() - began)


def _replaying(configuration: Configuration, session: zenoh.Session) -> Ask:
    """What has `cmd/replay` do something, as everybody else does."""
    asking = Asking(session, configuration.zenoh.prefix, "this service")
    return lambda request: asking.ask("cmd/replay", _REPLAY_TIMEOUT, request)


def _publisher(configuration: Configuration, session: zenoh.Session, once: bool) -> Publisher:
    section = configuration.zenoh
    return Publisher(session, section.prefix, lossless=once, raw_rate=section.raw_rate)


def _outputs(configuration: Configuration, output: Path | None, once: bool) -> dict[str, Callable[[], Sink]]:
    """The sinks that write to `--output`."""
    if output is None:
        return {}
    section = configuration.output
    budget = None if once else section.budget
    made: dict[str, Callable[[], Sink]] = {
        "fused file": lambda: Recorder(
            FileSeries(output / FUSED_FILE, section.rotate_size, budget),
            extras=Extras(section.points, section.depth_mm),
        )
    }
    if section.preview:
        keep = None if once else section.pictures
        made["pictures"] = lambda: Pictures(output, keep=keep, lossless=once)
    return made


def _summary(
    daemon: Daemon, bus: Bus, summaries: deque[BurstSummary], published: int, seconds: float
) -> RunSummary:
    known, counts = daemon.camera, daemon.grabber.counts
    assert known is not None
    return RunSummary(
        source=known.source,
        model=known.model,
        frames=counts.frames,
        stale=counts.stale,
        dropped_frames=counts.dropped,
        bursts=counts.bursts,
        fused=tuple(summaries),
        maps=daemon.ledger.fused,
        published=published,
        files=tuple(bus.files),
        seconds=seconds,
        lost=tuple(_lost(daemon, bus)),
    )


def _lost(daemon: Daemon, bus: Bus) -> list[str]:
    recording = daemon.recording
    said = [f"{recording.path}: {recording.damage}"] if recording is not None and recording.damage else []
    said += daemon.ledger.failures
    if daemon.fusing.backlog.dropped:
        said.append(
            f"{daemon.fusing.backlog.dropped} bursts not fused: the fusion did not keep up with the capture"
        )
    if daemon.grabber.counts.dropped and not (daemon.camera and daemon.camera.carries_pose):
        said.append(f"{daemon.grabber.counts.dropped} frames dropped by the camera")
    return said + bus.losses
