"""A serial line to an emulated device in virtual time, whose answers get lost, come late, or come twice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from emulators.pty_emulator import PtyEmulator

from drivers.clock import VirtualClock

_STEP = 0.01
"""Seconds after which a device is asked again whether time makes it say something."""


@dataclass(frozen=True)
class Fault:
    """What becomes of one answer.

    Attributes:
        kind: `lost`; `late`, and all that follows with it; `twice`, the second time later, by itself;
            `garbled`, so that something else arrives.
        seconds: by how much.
        pieces: what arrives instead, 0.05 s apart.
    """

    kind: Literal["lost", "late", "twice", "garbled"]
    seconds: float = 0.0
    pieces: tuple[bytes, ...] = ()


class VirtualLine:
    """Stands in for `serial.serial_for_url`: the device answers `DELAY` seconds after it was spoken to.

    Args:
        device: its `handle`, `tick` and `client_opened` are called here, none of its threads.
        clock: passes while the driver waits.
        faults: by number of the answer, counted from the first opening.
    """

    DELAY = 0.01

    def __init__(self, device: PtyEmulator, clock: VirtualClock, faults: Mapping[int, Fault] = {}) -> None:
        self.device, self._clock, self.faults = device, clock, faults
        self.answers = 0
        self.is_open = False
        device.now = lambda: clock.now() * 1e-9
        device.say = self._said  # type: ignore[method-assign]
        device.announce = self._announced  # type: ignore[method-assign]
        self._arrivals: list[tuple[float, bytes]] = []
        self._last = 0.0

    def open(self, _name: str, timeout: float = 0.0, **_: object) -> VirtualLine:
        self._timeout = timeout
        self._arrivals = []
        self.is_open = True
        self.device.client_opened()
        return self

    def close(self) -> None:
        self.is_open = False

    def write(self, data: bytes) -> int:
        self.device.handle(data)
        self.device.tick()
        return len(data)

    @property
    def in_waiting(self) -> int:
        return sum(len(data) for _, data in self._arrived())

    def read(self, size: int) -> bytes:
        end = self.device.now() + self._timeout
        while not self._arrived() and (left := end - self.device.now()) > 0:
            due = min((at for at, _ in self._arrivals), default=end) - self.device.now()
            self._clock.sleep(max(1e-6, min(left, due, _STEP)))
        data = b"".join(data for _, data in self._arrived())
        rest = [item for item in self._arrivals if item[0] > self.device.now()]
        self._arrivals = [(0.0, data[size:]), *rest] if data[size:] else rest
        return data[:size]

    def _arrived(self) -> list[tuple[float, bytes]]:
        self.device.tick()
        self._arrivals.sort(key=lambda item: item[0])
        return [item for item in self._arrivals if item[0] <= self.device.now()]

    def _said(self, data: bytes) -> None:
        fault = self.faults.get(self.answers, Fault("late"))
        self.answers += 1
        if fault.kind != "lost":
            late = fault.seconds if fault.kind == "late" else 0.0
            self._deliver(fault.pieces or (data,), late)
        if fault.kind == "twice":
            self._arrivals.append((self._last + fault.seconds, data))

    def _announced(self, data: bytes) -> None:
        self._deliver((data,))

    def _deliver(self, pieces: tuple[bytes, ...], late: float = 0.0) -> None:
        if self.device.mute:
            return
        at = max(self._last, self.device.now() + self.DELAY) + late
        for number, piece in enumerate(pieces):
            self._last = at + 0.05 * number
            self._arrivals.append((self._last, piece))
