"""Holding a camera that takes frames on request to a frame rate."""

from drivers.clock import Clock
from drivers.errors import DeviceTimeoutError


class Pacer:
    """An absolute schedule of requests; a late caller does not make later frames hurry."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._due = clock.now()

    def start(self) -> None:
        """The next frame is due at once."""
        self._due = self._clock.now()

    def wait(self, frame_rate: float | None, deadline: int) -> None:
        """Return when the next frame is due; at once without a frame rate.

        Raises:
            DeviceTimeoutError: it is due only after the deadline (clock time, ns).
        """
        if frame_rate is None:
            return
        if self._due > deadline:
            raise DeviceTimeoutError(
                f"at {frame_rate:g} frames/s the next frame is due after the time allowed"
            )
        now = self._clock.now()
        self._clock.sleep((self._due - now) / 1e9)
        self._due = max(self._due, now) + round(1e9 / frame_rate)
