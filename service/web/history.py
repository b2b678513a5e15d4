"""The last minutes in numbers, so that a page opened late can plot them."""

from collections import deque
from typing import Any

from service.messages.status import Drops, Status

_KEPT = 600
"""Samples, one a second."""


class History:
    """Makes a sample of every status that comes."""

    def __init__(self) -> None:
        self._samples: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._before: Status | None = None

    @property
    def samples(self) -> list[dict[str, Any]]:
        """Oldest first."""
        return list(self._samples)

    def add(self, status: Status, now: float) -> dict[str, Any]:
        """The sample of a status that came `now`, seconds since the epoch."""
        before, self._before = self._before, status
        if before is None or before.uptime > status.uptime:  # the first, or a service that was started again
            before = status
        disk = status.disk
        sample = {
            "time": now,
            "frames": status.rates.frames,
            "fused": status.rates.fused,
            "dropped": status.drops.camera - before.drops.camera,
            "skipped": _skipped(status.drops) - _skipped(before.drops),
            "failed": status.drops.fusions - before.drops.fusions,
            "latency": status.latency,
            "free": None if disk is None else disk.free,
            "minutes": None if disk is None else disk.minutes,
        }
        self._samples.append(sample)
        return sample


def _skipped(drops: Drops) -> int:
    return drops.bursts + drops.skipped
