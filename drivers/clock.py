"""Time as the drivers see it, so that simulated devices can run at once instead of in real time."""

import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """A clock that can be waited on."""

    def now(self) -> int:
        """Nanoseconds since the epoch, as it was set at the start; never jumps, never runs backwards."""

    def correction(self) -> int:
        """Nanoseconds to add to `now` for the time as it is set at present."""

    def sleep(self, seconds: float) -> None:
        """Wait; a negative or zero duration returns at once."""


_SET = 50_000_000
"""ns by which a clock must differ to have been set: what reading two of them one after the other may cost."""


class SystemClock:
    """Real time: the wall clock at creation, advanced by the monotonic one, so that no step of it harms.

    Args:
        wall, steady: nanoseconds since the epoch, and since any moment.
    """

    def __init__(
        self, wall: Callable[[], int] = time.time_ns, steady: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall, self._steady = wall, steady
        self._offset = wall() - steady()

    def now(self) -> int:
        return self._offset + self._steady()

    def correction(self) -> int:
        moved = self._wall() - self._steady() - self._offset
        return moved if abs(moved) > _SET else 0

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            time.sleep(seconds)


class VirtualClock:
    """Time that passes only by being slept through."""

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        return self._now

    def correction(self) -> int:
        return 0

    def sleep(self, seconds: float) -> None:
        self._now += max(0, round(seconds * 1e9))
