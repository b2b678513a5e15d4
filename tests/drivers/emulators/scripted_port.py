"""A serial port that plays a script of exchanges, byte for byte, in virtual time."""

from __future__ import annotations

from collections.abc import Sequence

import serial

from drivers.clock import VirtualClock

Reply = bytes | float | Exception
"""What comes back, in order: bytes, a pause in seconds, or a fault that lasts."""

Exchange = tuple[bytes, bytes | Sequence[Reply]]
"""What must be sent, in one write, and what comes back."""


class ScriptedPort:
    """Stands in for `serial.Serial`; fails on any deviation from the script."""

    def __init__(self, clock: VirtualClock, script: Sequence[Exchange], banner: Sequence[Reply] = ()) -> None:
        self._clock = clock
        self._script = list(script)
        self._arrivals: list[tuple[int, bytes | Exception]] = []
        self._fault: Exception | None = None
        self._timeout = 0.0
        self.is_open = False
        self._schedule(banner)

    def open(self, _name: str, timeout: float = 0.0, **_: object) -> ScriptedPort:
        """Takes the place of `serial.serial_for_url`."""
        self._timeout = timeout
        self.is_open = True
        return self

    def finish(self) -> None:
        """Fail on exchanges that did not happen and on bytes that nobody read."""
        assert not self._script, f"never sent: {self._script[0][0]!r} and {len(self._script) - 1} more"
        assert not self._arrivals, f"never read: {self._arrivals}"

    def write(self, data: bytes) -> int:
        self._raise_fault()
        assert self._script, f"sent {data!r} after the end of the script"
        expected, reply = self._script.pop(0)
        assert data == expected, f"sent {data!r} where the script has {expected!r}"
        self._schedule([reply] if isinstance(reply, bytes) else reply)
        return len(data)

    @property
    def in_waiting(self) -> int:
        self._raise_fault()
        return sum(
            len(item) for at, item in self._arrivals if at <= self._clock.now() and isinstance(item, bytes)
        )

    def read(self, size: int) -> bytes:
        self._raise_fault()
        if not self._arrivals or self._arrivals[0][0] > self._clock.now() + self._timeout * 1e9:
            self._clock.sleep(self._timeout)
            return b""
        at, item = self._arrivals.pop(0)
        self._clock.sleep((at - self._clock.now()) / 1e9)
        if isinstance(item, Exception):
            self._fault = item
            raise item
        if len(item) > size:
            self._arrivals.insert(0, (at, item[size:]))
        return item[:size]

    def close(self) -> None:
        self.is_open = False

    def _schedule(self, reply: Sequence[Reply]) -> None:
        at = self._clock.now()
        for item in reply:
            if isinstance(item, float):
                at += round(item * 1e9)
            elif item != b"":
                self._arrivals.append((at, item))

    def _raise_fault(self) -> None:
        if self._fault is not None:
            raise self._fault


UNPLUGGED = serial.SerialException("device reports readiness to read but returned no data")
