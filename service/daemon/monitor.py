"""Puts the counts of all parts together into the status, once a second and after every change of state."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from service.capture.grabber import CaptureCounts
from service.capture.rig import Rig
from service.daemon.disk import DiskWatch
from service.daemon.playing import Playing
from service.daemon.systemd import WATCHDOG, notify
from service.fusion.executor import Executor
from service.messages.events import ReplayTold, StatusTold
from service.messages.status import Drops, InForce, LastError, Rates, Status, Totals
from service.sinks.bus import Bus
from service.sinks.publisher import PUBLISHER, Publisher
from service.sinks.recorder import RECORDER, Recorder
from service.versions import software_version

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon


class Monitor:
    """Watches one run.

    Args:
        rig: open.
        capture: what happened to frames.
        daemon: the run.
        executor: who fuses.
        bus: who takes events.
        disk: where recordings go.
    """

    def __init__(
        self,
        rig: Rig,
        capture: CaptureCounts,
        daemon: Daemon,
        executor: Executor,
        bus: Bus,
        disk: DiskWatch,
    ) -> None:
        self._rig, self._capture, self._daemon = rig, capture, daemon
        self._executor, self._bus, self._disk = executor, bus, disk
        self._began = time.monotonic() - daemon.states.seconds  # it has been starting for so long
        self._seen = -1
        self._error: LastError | None = None

    def beat(self) -> None:
        """Look after the sinks, tell the status, feed the watchdog."""
        self._bus.watch()
        self._judge_sinks()
        self._judge_cluster()
        for look in self._daemon.lookouts:
            look()
        status = self.status()
        self._daemon.emit(StatusTold(status))
        if not isinstance(self._daemon.mode, Playing):
            self._daemon.emit(ReplayTold(self._daemon.replay))
        self._tell_systemd(status)

    def status(self) -> Status:
        """How things are now."""
        daemon, states, ledger = self._daemon, self._daemon.states, self._daemon.ledger
        fusion, sinks = self._executor.state, self._bus.states
        lost = {sink.name: sink.dropped for sink in sinks}
        recorder, publisher, camera = self._bus.sink(RECORDER), self._bus.sink(PUBLISHER), daemon.camera
        recording = recorder.state if isinstance(recorder, Recorder) else None
        return Status(
            timestamp=self._rig.clock.now() + self._rig.clock.correction(),
            version=software_version(),
            state=states.state,
            reason=states.reason,
            paused=daemon.control.paused,
            seconds=states.seconds,
            degraded=states.degraded,
            source=None if camera is None else camera.source,
            model=None if camera is None else camera.model,
            serial=None if camera is None else camera.serial,
            uptime=time.monotonic() - self._began,
            totals=Totals(
                frames=self._capture.frames,
                bursts=self._capture.bursts,
                fused=ledger.fused,
                unconverged=ledger.unconverged,
            ),
            rates=Rates(frames=ledger.frames.rate, fused=ledger.maps.rate),
            drops=Drops(
                camera=self._capture.dropped,
                stale=self._capture.stale,
                faults=self._capture.faults,
                bursts=self._capture.interrupted + daemon.fusing.backlog.dropped,
                skipped=daemon.fusing.backlog.skipped,
                fusions=ledger.failed,
                published=lost.get(PUBLISHER, 0),
                recorded=lost.get("recorder", 0),
            ),
            fusion=fusion,
            latency=ledger.latency,
            temperature=self._rig.camera.temperature,
            drift=daemon.supervision.drift,
            recorder=recording,
            disk=self._disk.state(recording),
            sinks=sinks,
            subscribers=publisher.subscribers if isinstance(publisher, Publisher) else (),
            commands=daemon.command_counts(),
            in_force=self._in_force(),
            error=self._last_error(self._capture.error or fusion.error),
        )

    def _in_force(self) -> InForce:
        settings = self._daemon.configuration
        return InForce(
            method=settings.fusion.method,
            upsampling=settings.fusion.upsampling,
            regularization=settings.fusion.regularization,
            frames=settings.fusion.frames,
            window=settings.stream.window,
            span=settings.plan.span,
            pause=settings.plan.pause,
            integration_time=self._rig.camera.settings.integration_time,
            modulation_frequency=self._rig.camera.settings.modulation_frequency,
        )

    def _last_error(self, what: str | None) -> LastError | None:
        if not what:
            self._error = None
        elif self._error is None or self._error.what != what:
            self._error = LastError(what=what, timestamp=self._rig.clock.now())
        return self._error

    def _judge_sinks(self) -> None:
        for sink in self._bus.states:
            if sink.state in ("restarting", "failed"):
                remedy = (
                    "it is started again by itself" if sink.state == "restarting" else "restart the service"
                )
                self._daemon.states.degrade(f"sink {sink.name}", f"{sink.name}: {sink.error}", remedy)
            else:
                self._daemon.states.mend(f"sink {sink.name}")

    def _judge_cluster(self) -> None:
        cluster = self._executor.state.cluster
        if cluster is not None and cluster.error is not None:
            self._daemon.states.degrade(
                "cluster",
                f"bursts are fused on this machine: {cluster.error}",
                "it is asked again by itself",
            )
        else:
            self._daemon.states.mend("cluster")

    def _tell_systemd(self, status: Status) -> None:
        """One line of status; the watchdog is fed while the state's own kind of progress is made."""
        line = (
            f"STATUS={status.state}, {status.rates.frames:.1f} frames/s, {status.totals.fused} maps, "
            f"{status.drops.camera} frames dropped"
        )
        tried = status.totals.frames + status.drops.stale + status.drops.faults
        progress = self._rig.beats + tried
        alive = progress != self._seen
        self._seen = progress
        notify(line, *([WATCHDOG] if alive else []))
