"""A Grbl 1.1h controller on a pty, as its interface manual describes it."""

from __future__ import annotations

import re
import time
from pathlib import Path

from emulators.pty_emulator import Motion, PtyEmulator

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"


class GrblEmulator(PtyEmulator):
    """Two rotary axes; opening the port resets the controller.

    Args:
        speed: degrees per second.
        homing: limit switches are fitted and homing is on.
    """

    def __init__(self, link: Path | None = None, speed: float = 400.0, homing: bool = False) -> None:
        super().__init__(link)
        self.settings = {20: 0, 22: int(homing), 23: 0, 100: 160.0, 101: 160.0, 130: 180.0, 131: 90.0}
        self.axes = {"X": Motion(speed), "Y": Motion(speed)}
        self.commands: list[str] = []
        self._banner_at: float | None = None
        self._input = b""
        self._restart()

    def restart(self) -> None:
        """A brown-out: the controller starts again by itself and has lost its position."""
        with self._lock:
            self._restart()
            self.say(BANNER)

    def hit_limit(self) -> None:
        """A limit switch closes: everything stops and is locked."""
        with self._lock:
            self._halt()
            self.alarm = True
            self.say(b"ALARM:1\r\n[MSG:Reset to continue]\r\n")

    def client_opened(self) -> None:
        self._restart()
        self._banner_at = time.monotonic() + 0.05

    def tick(self) -> None:
        if self._banner_at is not None and time.monotonic() >= self._banner_at:
            self._banner_at = None
            self.say(BANNER)
            if self.alarm:
                self.say(b"[MSG:'$H'|'$X' to unlock]\r\n")

    def handle(self, data: bytes) -> None:
        for byte in data:
            character = bytes([byte])
            if character == b"?":
                self.say(self._report())
            elif character == b"\x18":
                self._halt()
                self._input = b""
                self.alarm = self.settings[22] == 1
                self._banner_at = time.monotonic()
            elif character == b"\n":
                line, self._input = self._input.decode("ascii", "replace").strip(), b""
                self._execute(line)
            else:
                self._input += character

    def _restart(self) -> None:
        self.alarm = self.settings[22] == 1
        for axis in self.axes.values():
            axis.set(0.0)

    def _halt(self) -> None:
        for axis in self.axes.values():
            axis.stop()

    def _report(self) -> bytes:
        moving = any(axis.moving for axis in self.axes.values())
        state = "Alarm" if self.alarm else "Run" if moving else "Idle"
        x, y = (axis.position for axis in self.axes.values())
        return f"<{state}|MPos:{x:.3f},{y:.3f},0.000|FS:0,0>\r\n".encode()

    def _execute(self, line: str) -> None:
        self.commands.append(line)
        if line == "$$":
            self.say(b"".join(f"${key}={value}\r\n".encode() for key, value in self.settings.items()))
            self._ok()
        elif line == "$I":
            self.say(b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\n")
            self._ok()
        elif line == "$H":
            self._home()
        elif line == "$X":
            self.alarm = False
            self.say(b"[MSG:Caution: Unlocked]\r\n")
            self._ok()
        elif self.alarm:
            self.say(b"error:9\r\n")
        elif line == "G21 G90 G94":
            self._ok()
        elif line.startswith("G53 G0 "):
            for letter, value in re.findall(r"([XY])(-?\d+\.\d+)", line):
                steps = self.settings[100 + "XY".index(letter)]
                self.axes[letter].go(round(float(value) * steps) / steps)
            self._ok()
        else:
            self.say(b"error:20\r\n")

    def _home(self) -> None:
        if not self.settings[22]:
            self.say(b"error:5\r\n")
            return
        self.alarm = False
        for axis in self.axes.values():
            axis.set(-1.0)  # pulled off the switch at the end of the travel
        self._ok()

    def _ok(self) -> None:
        self.say(b"ok\r\n")
