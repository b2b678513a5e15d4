"""Puts the counts of all parts together into the status."""

import time

from service.capture.loop import CaptureCounts
from service.capture.rig import Rig
from service.fusion.worker import FusionWorker
from service.health.status import Drops, Meter, Rates, State, Status, Totals
from service.health.systemd import WATCHDOG, notify
from service.output.outlets import Outlets
from service.versions import software_version


class Monitor:
    """Watches one run.

    Args:
        rig: open.
        capture: what happened to frames.
        worker: the fusion.
        outlets: where results go.
    """

    def __init__(self, rig: Rig, capture: CaptureCounts, worker: FusionWorker, outlets: Outlets) -> None:
        self.state: State = "starting"
        self._rig, self._capture, self._worker, self._outlets = rig, capture, worker, outlets
        self._camera = rig.camera.capabilities  # kept: a lost camera cannot be asked
        self._began = time.monotonic()
        self._frames, self._maps = Meter(), Meter()
        self._latency: float | None = None
        self._seen = 0

    def frame(self) -> None:
        """A frame came."""
        self._frames.tick()

    def map(self, latency: float | None) -> None:
        """A map was fused."""
        self._maps.tick()
        self._latency = latency

    def status(self) -> Status:
        """How things are now."""
        worker = self._worker.counts
        return Status(
            timestamp=self._rig.clock.now(),
            version=software_version(),
            state="recovering" if self._rig.is_recovering else self.state,
            source=self._camera.source,
            model=self._camera.model,
            serial=self._camera.serial,
            uptime=time.monotonic() - self._began,
            totals=Totals(frames=self._capture.frames, bursts=self._capture.bursts, fused=worker.fused),
            rates=Rates(frames=self._frames.rate, fused=self._maps.rate),
            drops=Drops(
                camera=self._capture.dropped,
                stale=self._capture.stale,
                faults=self._capture.faults,
                bursts=self._capture.interrupted + worker.dropped,
                fusions=worker.failed,
                published=sum(self._outlets.publisher.dropped.values()),
                recorded=sum(recorder.state.dropped for recorder in self._outlets.recorders),
            ),
            backlog=self._worker.waiting,
            latency=self._latency,
            recorder=self._outlets.shelf.state,
            error=self._capture.error or worker.error or None,
        )

    def tell_systemd(self, status: Status) -> None:
        """One line of status; the watchdog is fed only while frames come, or none are meant to."""
        line = (
            f"STATUS={status.state}, {status.rates.frames:.1f} frames/s, {status.totals.fused} maps, "
            f"{status.drops.camera} frames dropped"
        )
        alive = status.totals.frames > self._seen or status.state == "idle"
        self._seen = status.totals.frames
        notify(line, *([WATCHDOG] if alive else []))
