"""Time as the drivers see it, so that simulated devices can run at once instead of in real time."""

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that can be waited on."""

    def now(self) -> int:
        """Nanoseconds since the epoch; never runs backwards."""

    def sleep(self, seconds: float) -> None:
        """Wait; a negative or zero duration returns at once."""


class SystemClock:
    """Real time: the wall clock at creation, advanced by the monotonic one, so that no step of it harms."""

    def __init__(self) -> None:
        self._offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        return self._offset + time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            time.sleep(seconds)


class VirtualClock:
    """Time that passes only by being slept through."""

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        return self._now

    def sleep(self, seconds: float) -> None:
        self._now += max(0, round(seconds * 1e9))
