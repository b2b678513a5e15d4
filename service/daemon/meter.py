"""How often something happens."""

import time
from collections import deque
from collections.abc import Callable
from threading import Lock

_WINDOW = 10.0
"""Seconds over which rates are taken: at one burst in some seconds a shorter window would jump."""


class Meter:
    """Events per second over the last ten seconds; may be used from several threads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = clock()
        self._events: deque[float] = deque()
        self._lock = Lock()

    def tick(self) -> None:
        """Count an event."""
        with self._lock:
            self._events.append(self._clock())
            self._forget()

    @property
    def rate(self) -> float:
        """Events per second; while younger than the window, over its own age."""
        with self._lock:
            self._forget()
            span = min(_WINDOW, self._clock() - self._began)
            return len(self._events) / span if span > 0 else 0.0

    def _forget(self) -> None:
        oldest = self._clock() - _WINDOW
        while self._events and self._events[0] < oldest:
            self._events.popleft()
