"""How often something may happen."""

import time
from collections.abc import Callable
from threading import Lock


class Allowance:
    """So many a second in the long run, and some at once; for any thread.

    Args:
        rate: per second.
        most: at once.
        clock: seconds.
    """

    def __init__(self, rate: float, most: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._most, self._clock = rate, most, clock
        self._left, self._at = most, clock()
        self._lock = Lock()

    def spend(self) -> bool:
        """Whether one more is allowed."""
        with self._lock:
            now = self._clock()
            self._left = min(self._most, self._left + (now - self._at) * self._rate)
            self._at = now
            if self._left < 1:
                return False
            self._left -= 1
            return True
