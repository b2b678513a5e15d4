"""A Directed Perception / FLIR pan-tilt unit, as its manual describes it, on a pty or a virtual line."""

from __future__ import annotations

import re
from math import radians
from pathlib import Path

from emulators.pty_emulator import Motion, PtyEmulator

RESOLUTION = 185.142800
COUNT = radians(RESOLUTION / 3600)
LIMITS = {"P": (-3090, 3090), "T": (-907, 604)}
NAMES = {"P": "Pan", "T": "Tilt"}
BANNER = "Pan-Tilt Controller v2.12.1d1(C14/E), (C)2003 Directed Perception, Inc., All Rights Reserved"


class PtuEmulator(PtyEmulator):
    """A PTU-D46-17, with faults that a test can cause; positions count from its last calibration.

    Args:
        fastest: upper bound of the speed, positions per second.
        boot_seconds: how long it calibrates itself, silently, after power-up.
    """

    def __init__(self, link: Path | None = None, fastest: int = 60_000, boot_seconds: float = 0.0) -> None:
        super().__init__(link)
        self.fastest, self._boot_seconds = fastest, boot_seconds
        self.axes = {letter: Motion(1000, lambda: self.now()) for letter in "PT"}
        self.slipped = {"P": 0.0, "T": 0.0}
        """Positions by which an axis is off what the unit believes."""
        self.commands: list[str] = []
        self.times: list[float] = []
        self.moves: list[tuple[float, float]] = []
        """Where the head was sent to, pan and tilt, radians, by whatever cause."""
        self.halts: list[float] = []
        self.scans = False
        self.limits_enforced = True
        self._power_up()

    @property
    def moving(self) -> bool:
        return self._resetting or any(axis.moving for axis in self.axes.values())

    @property
    def true_angles(self) -> tuple[float, float]:
        """Where the head really points, radians."""
        pan, tilt = ((self.axes[letter].position + self.slipped[letter]) * COUNT for letter in "PT")
        return pan, tilt

    def power_cycle(self) -> None:
        """Power fails and comes back: what was not saved is lost, and the head calibrates itself."""
        with self._lock:
            self._power_up()
            for letter, axis in self.axes.items():
                axis.set(0)
                self.slipped[letter] = 0.0

    def lose_count(self) -> None:
        """Power fails and comes back; it does not calibrate itself, so zero is where it stands."""
        with self._lock:
            self._power_up()
            for letter, axis in self.axes.items():
                self.slipped[letter] += axis.position
                axis.set(0)

    def run_into_limit(self, axis: str) -> None:
        """The axis is blocked: it loses steps, stops, and says so."""
        with self._lock:
            self.axes[axis].stop()
            self.slipped[axis] += 40
            self.announce(b"!" + axis.encode() + b"\r\n")

    def autoscan(self) -> None:
        """It turns to and fro until it gets a byte."""
        with self._lock:
            self.scans = True
            self.axes["P"].go(3000)

    def _power_up(self) -> None:
        self.echo, self.verbose = True, True
        self._input = b""
        self._resetting = False
        self.resets_axes = True
        for axis in self.axes.values():
            axis.speed = 1000
            axis.stop()
        self.acceleration = {"P": 2000, "T": 2000}
        self._reply_at: tuple[float, bytes] | None = None
        self._asleep_until = self.now() + self._boot_seconds if self._boot_seconds else 0.0

    def handle(self, data: bytes) -> None:
        if self.now() < self._asleep_until:
            return
        if self.scans:
            self.scans = False
            self._go("P", 0)
        if self.echo:
            self.announce(data)
        self._input += data

    def tick(self) -> None:
        if self._reply_at is not None and self.now() >= self._reply_at[0]:
            self._resetting = False
            self.say(self._reply_at[1])
            self._reply_at = None
        while self._reply_at is None:  # a reset holds back whatever follows it
            found = re.match(rb"([^ \r\n]*)[ \r\n]", self._input)
            if found is None:
                return
            self._input = self._input[found.end() :]
            if found[1]:
                self._execute(found[1].decode("ascii", "replace").upper())

    def _execute(self, command: str) -> None:
        self.commands.append(command)
        self.times.append(self.now())
        if found := re.fullmatch(r"([PT])([PO])([+-]?\d+)", command):
            self._move(found[1], int(found[3]) + (found[2] == "O") * round(self.axes[found[1]].position))
        elif found := re.fullmatch(r"([PT])S(\d+)", command):
            self._set_speed(found[1], int(found[2]))
        elif found := re.fullmatch(r"([PT])A(\d+)", command):
            self.acceleration[found[1]] = int(found[2])
            self.say(b"*\r\n")
        elif command == "H":
            self.halts.append(self.now())
            for axis in self.axes.values():
                axis.stop()
            self.say(b"*\r\n")
        elif command == "R":
            self._reset()
        elif command in ("FT", "FV", "EE", "ED", "CI", "I", "LE", "LD", "RE", "RD"):
            self._set_mode(command)
            self.say(b"*\r\n")
        else:
            self._answer(command)

    def _set_mode(self, command: str) -> None:
        if command in ("FT", "FV"):
            self.verbose = command == "FV"
        elif command in ("EE", "ED"):
            self.echo = command == "EE"
        elif command in ("LE", "LD"):
            self.limits_enforced = command == "LE"
        elif command in ("RE", "RD"):
            self.resets_axes = command == "RE"

    def _set_speed(self, axis: str, speed: int) -> None:
        if 31 <= speed <= self.fastest:
            here, self.axes[axis].speed = self.axes[axis].position, speed
            self.axes[axis].resume(here)
            self.say(b"*\r\n")
        else:
            self._refuse(f"{NAMES[axis]} speed cannot exceed {self.fastest} positions/sec")

    def _reset(self) -> None:
        if not self.resets_axes:
            self.say(b"*\r\n")
            return
        self.moves.append((0.0, 0.0))
        for letter, axis in self.axes.items():
            axis.set(0)
            self.slipped[letter] = 0.0
        self._resetting = True
        self._reply_at = self.now() + 0.05, b"!T!T!P!P*\r\n"

    def _move(self, axis: str, target: int) -> None:
        low, high = LIMITS[axis]
        if low <= target <= high or not self.limits_enforced:
            self._go(axis, target)
            self.say(b"*\r\n")
        else:
            self._refuse(f"Maximum allowable {NAMES[axis]} position is {high}")

    def _go(self, axis: str, target: int) -> None:
        self.axes[axis].go(target)
        pan, tilt = ((self.axes[letter].target + self.slipped[letter]) * COUNT for letter in "PT")
        self.moves.append((pan, tilt))

    def _answer(self, command: str) -> None:
        axis, what = command[:1], command[1:]
        if command == "V":
            self.say(f"* {BANNER}\r\n".encode())
        elif command == "L":
            state = "ENABLED (soft limits enabled)" if self.limits_enforced else "DISABLED (hard limits only)"
            self.say(f"* Limit bounds are {state}\r\n".encode())
        elif axis in self.axes and what in self._values(axis):
            words, value, unit = self._values(axis)[what]
            said = f"* {words} {value} {unit}" if self.verbose else f"* {value}"
            self.say(f"{said.strip()}\r\n".encode())
        else:
            self._refuse("Illegal command")

    def _values(self, axis: str) -> dict[str, tuple[str, object, str]]:
        name, motion, (low, high) = NAMES[axis], self.axes[axis], LIMITS[axis]
        return {
            "P": (f"Current {name} position is", round(motion.position), ""),
            "O": (f"Target {name} position is", round(motion.target), ""),
            "R": ("", f"{RESOLUTION:.6f}", "seconds arc per position"),
            "N": (f"Minimum {name} position is", low, ""),
            "X": (f"Maximum {name} position is", high, ""),
            "S": (f"Target {name} speed is", motion.speed, "positions/sec"),
            "U": (f"Maximum {name} speed is", self.fastest, "positions/sec"),
            "L": (f"Minimum {name} speed is", 31, "positions/sec"),
            "A": (f"{name} acceleration is", self.acceleration[axis], "positions/sec^2"),
        }

    def _refuse(self, words: str) -> None:
        self.say(f"! {words}\r\n".encode() if self.verbose else b"!\r\n")
