"""A Directed Perception / FLIR pan-tilt unit on a pty, as its manual describes it."""

from __future__ import annotations

import re
import time
from pathlib import Path

from emulators.pty_emulator import Motion, PtyEmulator

RESOLUTION = 185.142800
LIMITS = {"P": (-3090, 3090), "T": (-907, 604)}


class PtuEmulator(PtyEmulator):
    """A PTU-D46-17, with faults that a test can cause.

    Args:
        speed: positions per second.
        boot_seconds: how long it calibrates itself, silently, after power-up.
    """

    def __init__(self, link: Path | None = None, speed: float = 20_000, boot_seconds: float = 0.0) -> None:
        super().__init__(link)
        self.axes = {"P": Motion(speed), "T": Motion(speed)}
        self.commands: list[str] = []
        self._boot_seconds = boot_seconds
        self._reply_at: tuple[float, bytes] | None = None
        self._power_up()

    def power_cycle(self) -> None:
        """Power fails and comes back: what was not saved is lost, and the head calibrates itself."""
        with self._lock:
            self._power_up()
            for axis in self.axes.values():
                axis.set(0)

    def run_into_limit(self, axis: str) -> None:
        """The axis is blocked: it stops and says so."""
        with self._lock:
            self.axes[axis].stop()
            self.say(b"!" + axis.encode() + b"\r\n")

    def _power_up(self) -> None:
        self.echo, self.terse = True, False
        self._input = b""
        self._awaiting = False
        self._reply_at = None
        self._asleep_until = time.monotonic() + self._boot_seconds

    def handle(self, data: bytes) -> None:
        if time.monotonic() < self._asleep_until:
            return
        if self.echo:
            self.say(data)
        self._input += data

    def tick(self) -> None:
        if self._awaiting and not any(axis.moving for axis in self.axes.values()):
            self._awaiting = False
            self.say(b"*\r\n")
        if self._reply_at is not None and time.monotonic() >= self._reply_at[0]:
            self.say(self._reply_at[1])
            self._reply_at = None
        # `A` and `R` hold back whatever follows them.
        while not self._awaiting and self._reply_at is None:
            found = re.match(rb"([^ \r\n]*)[ \r\n]", self._input)
            if found is None:
                return
            self._input = self._input[found.end() :]
            if found[1]:
                self._execute(found[1].decode("ascii", "replace").upper())

    def _execute(self, command: str) -> None:
        self.commands.append(command)
        found = re.fullmatch(r"([PT])([PO])([+-]?\d+)", command)
        if found:
            self._move(found[1], int(found[3]) + (found[2] == "O") * round(self.axes[found[1]].position))
        elif command in ("FT", "FV"):
            self.terse = command == "FT"
            self._done()
        elif command in ("EE", "ED"):
            self.echo = command == "EE"
            self._done()
        elif command in ("CI", "I"):
            self._done()
        elif command == "A":
            self._awaiting = True
        elif command == "R":
            for axis in self.axes.values():
                axis.set(0)
            self._reply_at = time.monotonic() + 0.05, b"!T!T!P!P*\r\n"
        else:
            self._answer(command)

    def _move(self, axis: str, target: int) -> None:
        low, high = LIMITS[axis]
        if low <= target <= high:
            self.axes[axis].go(target)
            self._done()
        else:
            self.say(b"!\r\n" if self.terse else b"! Maximum allowable position exceeded\r\n")

    def _answer(self, command: str) -> None:
        axis, what = command[:1], command[1:]
        values = {
            "P": lambda: f"{round(self.axes[axis].position)}",
            "R": lambda: f"{RESOLUTION:.6f}",
            "N": lambda: f"{LIMITS[axis][0]}",
            "X": lambda: f"{LIMITS[axis][1]}",
            "S": lambda: f"{self.axes[axis].speed:.0f}",
            "A": lambda: "200000",
        }
        if axis not in self.axes or what not in values:
            self.say(b"! Illegal command\r\n" if not self.terse else b"!\r\n")
            return
        value = values[what]()
        words = "" if self.terse else f" is the {what} value of axis {axis}"
        self.say(f"* {value}{words}\r\n".encode())

    def _done(self) -> None:
        self.say(b"*\r\n")
