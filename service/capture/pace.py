"""When a burst had better begin: so that it is complete as soon as the fusion is free, and not before."""

import logging
import time
from collections import deque
from collections.abc import Callable, Hashable
from statistics import median
from threading import Lock

_REMEMBERED = 5
"""Bursts of which it is known how long they took: one that was disturbed shall not count."""

_log = logging.getLogger(__name__)


class Pace:
    """Holds the capture back where the fusion is slower.

    The next burst is captured while the last one is fused. What is captured faster than that waits, grows old
    and in the end gives way to what comes after it; begun later, it is fused as soon, and nothing is lost.

    Args:
        clock: seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._kind: Hashable = None
        self._capturing: deque[float] = deque(maxlen=_REMEMBERED)
        self._fusing: deque[float] = deque(maxlen=_REMEMBERED)
        self._unfinished = 0
        self._since = 0.0
        self._told = False
        self._lock = Lock()  # bursts and maps come from different threads

    def wait(self) -> float:
        """Seconds that the next burst had better wait before it begins, as it looks now."""
        with self._lock:
            now = self._clock()
            if not (self._capturing and self._unfinished):
                return 0.0
            if not self._fusing:  # it takes longer than so far; one that waits is enough until that is known
                return now - self._since if self._unfinished > 1 else 0.0
            capturing, fusing = median(self._capturing), median(self._fusing)
            free = max(now, self._since + _mostly(self._fusing)) + (self._unfinished - 1) * fusing
        wait = max(0.0, free - now - capturing)
        if wait > 0 and fusing > capturing and not self._told:
            self._told = True
            _log.info(
                "a burst is fused in %.2f s and captured in %.2f s: the capture waits for the fusion",
                fusing,
                capturing,
            )
        return wait

    def captured(self, seconds: float, kind: Hashable) -> None:
        """A burst is handed over that took so long; `kind`: what else its fusion takes as long as."""
        with self._lock:
            if kind != self._kind:
                self._kind, self._told = kind, False
                self._fusing.clear()
            self._capturing.append(seconds)
            if self._unfinished == 0:
                self._since = self._clock()
            self._unfinished += 1

    def fused(self) -> None:
        """The oldest of them is done, with a map or without."""
        with self._lock:
            now = self._clock()
            self._fusing.append(now - self._since)
            self._since = now
            self._unfinished -= 1

    def dropped(self) -> None:
        """One of them was given up before it was begun."""
        with self._lock:
            self._unfinished -= 1


def _mostly(seconds: deque[float]) -> float:
    """What three quarters of them do not exceed: a burst that is complete sooner grows old in the queue."""
    ordered = sorted(seconds)
    return ordered[round(0.75 * (len(ordered) - 1))]
