"""What a run has done so far: totals, rates and the last faults, for status and summary."""

from collections import deque

from service.daemon.meter import Meter
from service.messages.events import BurstCaptured, Event, FrameCaptured, FusionFailed, MapFused

_REMEMBERED = 1000
"""Failures of which a run keeps the reason: the service runs for weeks."""


class Ledger:
    """Takes note of events as they are emitted."""

    def __init__(self) -> None:
        self.frames, self.maps = Meter(), Meter()
        self.captured = self.bursts = self.fused = self.unconverged = self.failed = 0
        self.latency: float | None = None
        self.failures: deque[str] = deque(maxlen=_REMEMBERED)

    def note(self, event: Event) -> None:
        """Count an event."""
        if isinstance(event, FrameCaptured):
            self.captured += 1
            self.frames.tick()
        elif isinstance(event, BurstCaptured):
            self.bursts += 1
        elif isinstance(event, MapFused):
            self.fused += 1
            self.unconverged += not event.map.report.converged
            self.latency = event.map.report.latency
            self.maps.tick()
        elif isinstance(event, FusionFailed):
            self.failed += 1
            self.failures.append(f"burst {event.number} not fused: {event.reason}")
