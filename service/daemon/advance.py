"""How far the burst at work is, from what is captured and fused."""

import time
from collections.abc import Callable
from threading import Lock

from service.messages.events import Event, FrameCaptured, FusionFailed, MapFused, SolverAdvanced
from service.messages.progress import ScanProgress


class Advance:
    """Follows the bursts of a run; for any thread.

    Args:
        poses: of a whole burst, where that is known.
        unfinished: how many bursts wait for their map or are being fused.
        clock: seconds.
    """

    def __init__(
        self,
        poses: Callable[[], int | None],
        unfinished: Callable[[], int],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._poses, self._unfinished, self._clock = poses, unfinished, clock
        self._latest: ScanProgress | None = None
        self._began = 0.0
        self._lock = Lock()  # frames and maps come from different threads

    def after(self, event: Event) -> ScanProgress | None:
        """The progress after an event; None where it made none."""
        with self._lock:
            return self._after(event)

    def _after(self, event: Event) -> ScanProgress | None:
        if isinstance(event, FrameCaptured) and event.frame.burst is not None:
            self._latest = self._captured(event.frame.burst, event.frame.timestamp)
        elif isinstance(event, (MapFused, FusionFailed)) and self._latest is not None:
            # The one that this event is about is not finished with yet.
            left = max(0, self._unfinished() - 1)
            self._latest = self._latest.model_copy(update={"fusing": left, "solver": None})
        elif isinstance(event, SolverAdvanced) and self._latest is not None:
            self._latest = self._latest.model_copy(update={"solver": event.progress})
        else:
            return None
        return self._latest

    def _captured(self, burst: int, timestamp: int) -> ScanProgress:
        last = self._latest
        captured = 1 if last is None or last.burst != burst else last.captured + 1
        if captured == 1:
            self._began = self._clock()
        poses = self._poses()
        seconds = None
        if poses is not None and captured > 1:
            each = (self._clock() - self._began) / (captured - 1)
            seconds = max(0, poses - captured) * each
        return ScanProgress(
            timestamp=timestamp,
            burst=burst,
            poses=poses,
            captured=captured,
            seconds=seconds,
            fusing=self._unfinished(),
            solver=None if last is None else last.solver,
        )
