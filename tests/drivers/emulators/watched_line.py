"""A line in virtual time that keeps what is sent over it, and can be pulled out."""

from __future__ import annotations

from collections.abc import Sequence

import serial
from emulators.pty_emulator import PtyEmulator
from emulators.virtual_line import Fault, VirtualLine

from drivers.clock import VirtualClock


class WatchedLine(VirtualLine):
    """Attributes:
    writes: (seconds, bytes) that were sent to the device.
    plugged: whether the cable is in.
    """

    def __init__(self, device: PtyEmulator, clock: VirtualClock) -> None:
        super().__init__(device, clock, {})
        self.writes: list[tuple[float, bytes]] = []
        self.plugged = True

    def spoil(self, faults: Sequence[Fault | None]) -> None:
        """What becomes of the next answers."""
        following = {self.answers + n: fault for n, fault in enumerate(faults) if fault}
        self.faults = {**self.faults, **following}

    def write(self, data: bytes) -> int:
        self._require_plugged()
        self.writes.append((self.device.now(), data))
        return super().write(data)

    def read(self, size: int) -> bytes:
        self._require_plugged()
        return super().read(size)

    @property
    def in_waiting(self) -> int:
        self._require_plugged()
        return super().in_waiting

    def _require_plugged(self) -> None:
        if not self.plugged:
            raise serial.SerialException("device reports readiness to read but returned no data")
