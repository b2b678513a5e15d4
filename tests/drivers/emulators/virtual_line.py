"""A device on a serial port in virtual time, whose answers can come late, twice or not at all."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import serial

from drivers.clock import VirtualClock

LOST, DOUBLED = "lost", "doubled"

Fault = str | float | None
"""What happens to one answer: lost, doubled, late by so many seconds, or nothing."""


class VirtualLine:
    """Stands in for `serial.Serial`; the line keeps order. A subclass fills `handle`.

    Attributes:
        faults: what happens to the next answers, one each.
        question: what it is being asked; a subclass says.
        answered: the questions of all answers so far.
        writes: (seconds, bytes) that were sent to the device.
    """

    LATENCY = 0.002

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._timeout = 0.0
        self._arrivals: deque[tuple[float, bytes]] = deque()
        self._due: list[tuple[float, Callable[[], None]]] = []
        self.faults: deque[Fault] = deque()
        self.question = ""
        self.answered: list[str] = []
        self.writes: list[tuple[float, bytes]] = []
        self.plugged, self.mute = True, False

    def now(self) -> float:
        """Seconds."""
        return self._clock.now() / 1e9

    def after(self, seconds: float, action: Callable[[], None]) -> None:
        """Have something happen by itself."""
        self._due.append((self.now() + seconds, action))

    def say(self, data: bytes) -> None:
        """Send one answer to the client."""
        self.answered.append(self.question)
        fault = self.faults.popleft() if self.faults else None
        if self.mute or fault == LOST:
            return
        late = fault if isinstance(fault, float) else 0.0
        at = self.now() + self.LATENCY + late
        if self._arrivals:
            at = max(at, self._arrivals[-1][0])
        self._arrivals.append((at, data * 2 if fault == DOUBLED else data))

    def handle(self, data: bytes) -> None:
        """Bytes have come in."""
        raise NotImplementedError

    def client_opened(self) -> None:
        """A client has opened the port."""

    def open(self, _name: str, timeout: float = 0.0, **_: object) -> VirtualLine:
        """Takes the place of `serial.serial_for_url`."""
        self._require_plugged()
        self._timeout = timeout
        self._arrivals.clear()
        self.client_opened()
        return self

    def write(self, data: bytes) -> int:
        self._require_plugged()
        self.run()
        self.writes.append((self.now(), data))
        self.handle(data)
        return len(data)

    @property
    def in_waiting(self) -> int:
        self._require_plugged()
        self.run()
        return sum(len(data) for at, data in self._arrivals if at <= self.now())

    def read(self, size: int) -> bytes:
        end = self.now() + self._timeout
        while True:
            self._require_plugged()
            self.run()
            if self._arrivals and self._arrivals[0][0] <= self.now():
                at, data = self._arrivals.popleft()
                if len(data) > size:
                    self._arrivals.appendleft((at, data[size:]))
                return data[:size]
            upcoming = [at for at, _ in self._due] + [at for at, _ in self._arrivals]
            step = min([end, *upcoming]) - self.now()
            if self.now() >= end:
                return b""
            self._clock.sleep(max(step, 1e-6))

    def run(self) -> None:
        """Let happen what is due."""
        due = [entry for entry in self._due if entry[0] <= self.now()]
        self._due = [entry for entry in self._due if entry[0] > self.now()]
        for _, action in sorted(due, key=lambda entry: entry[0]):
            action()

    def close(self) -> None:
        pass

    def _require_plugged(self) -> None:
        if not self.plugged:
            raise serial.SerialException("device reports readiness to read but returned no data")
