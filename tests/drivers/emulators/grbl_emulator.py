"""A Grbl 1.1h controller, as its manual and its source (gnea/grbl) describe it."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable
from math import hypot, radians
from pathlib import Path

from emulators.pty_emulator import PtyEmulator

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
SETTINGS = {
    1: "255",
    10: "1",
    13: "0",
    20: "0",
    21: "0",
    22: "0",
    23: "0",
    24: "300.000",
    25: "600.000",
    100: "160.000",
    101: "160.000",
    102: "250.000",
    110: "24000.000",
    111: "24000.000",
    112: "500.000",
    120: "20.000",
    121: "20.000",
    122: "10.000",
    130: "180.000",
    131: "90.000",
    132: "200.000",
}
JOG = re.compile(r"\$J=G53 G90 G21 ((?:[XY]-?\d+\.\d+ )+)F(\d+\.\d+)")

Angles = dict[str, float]


class Leg:
    """One straight movement at constant speed."""

    def __init__(self, start: Angles, end: Angles, speed: float, at: float) -> None:
        self.start, self.end, self.speed, self.at = start, end, speed, at
        self.length = hypot(*(end[letter] - start[letter] for letter in end))

    @property
    def until(self) -> float:
        return self.at + self.length / self.speed

    def where(self, now: float) -> Angles:
        share = 1.0 if now >= self.until else (now - self.at) * self.speed / self.length
        return {letter: at + share * (self.end[letter] - at) for letter, at in self.start.items()}


class GrblEmulator(PtyEmulator):
    """Two rotary axes; opening the port resets the controller.

    Args:
        homing: limit switches are fitted and homing is on.

    Attributes:
        commands: the lines that were carried out.
        moves: where it was sent to, true angles in radians; a homing counts as one to (0, 0).
        halts: when it was told to halt.
        slip: what to add to each machine position for the true angle, degrees.
    """

    HOMING_SECONDS = 0.3
    PULL_OFF = 1.0
    resets_on_opening = True

    def __init__(self, link: Path | None = None, homing: bool = False) -> None:
        super().__init__(link)
        self.settings = {**SETTINGS, 22: "1" if homing else "0"}
        self.startup = ["", ""]
        self.build_info = b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\n"
        self.commands: list[str] = []
        self.moves: list[tuple[float, float]] = []
        self.halts: list[float] = []
        self.slip: Angles = {"X": 0.0, "Y": 0.0}
        self._machine: Angles = {"X": 0.0, "Y": 0.0}
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._boot()

    @property
    def true_angles(self) -> tuple[float, float]:
        """Where the axes really point, radians."""
        return radians(self.true["X"]), radians(self.true["Y"])

    @property
    def true(self) -> Angles:
        """Where the axes really point, degrees."""
        self._advance()
        return {letter: at + self.slip[letter] for letter, at in self._machine.items()}

    @property
    def moving(self) -> bool:
        self._advance()
        return (bool(self._legs) and self.state in ("Jog", "Run")) or self.phase == 1 or self.state == "Home"

    def turn_by_hand(self, **to: float) -> None:
        """Somebody turns the axes while the motors have no power, or lets them slip."""
        for letter, angle in to.items():
            self.slip[letter] += angle - self.true[letter]

    def restart(self) -> None:
        """A brown-out: the controller starts again by itself and has lost its position."""
        with self._lock:
            self._lose_position()
            self.announce(BANNER)

    def hit_limit(self) -> None:
        """A limit switch closes: everything stops and is locked until a reset; steps are lost."""
        with self._lock:
            self._kill(1.5)
            self.state, self._critical = "Alarm", True
            self.announce(b"ALARM:1\r\n[MSG:Reset to continue]\r\n")

    def run_program(self, **to: float) -> None:
        """A movement that is no jog, as another program would begin it."""
        self.state = "Run"
        self._enqueue(to, 10.0)

    def client_opened(self) -> None:
        if self.resets_on_opening:
            self._lose_position()
            self._due.append((self.now() + 0.05, self._greet))

    def handle(self, data: bytes) -> None:
        for byte in data:
            character = bytes([byte])
            self._advance()
            if character == b"?":
                if self.state != "Home" and not self._critical:
                    self.say(self._report())
            elif character == b"\x18":
                self.halts.append(self.now())
                self._reset()
            elif character == b"!":
                self.halts.append(self.now())
                self._hold()
            elif character == b"\x85":
                if self.state == "Jog":
                    self._hold()
            elif character == b"~":
                self._resume()
            elif character == b"\n":
                self._lines.append(self._input.decode("ascii", "replace").strip())
                self._input = b""
            elif byte < 0x80:
                self._input += character
        self._work()

    def tick(self) -> None:
        due = [action for at, action in self._due if at <= self.now()]
        self._due = [entry for entry in self._due if entry[0] > self.now()]
        for action in due:
            action()
        self._advance()
        self._work()

    def _greet(self) -> None:
        self.say(BANNER + (b"[MSG:'$H'|'$X' to unlock]\r\n" if self.state == "Alarm" else b""))

    def _boot(self) -> None:
        self.state = "Alarm" if self.settings[22] == "1" else "Idle"
        self._begin()

    def _begin(self) -> None:
        self.phase = 0
        self._input, self._lines = b"", deque[str]()
        self._legs: deque[Leg] = deque()
        self._remainder: list[Angles] = []
        self._critical = self._cancelling = False
        self._homing_run = 0

    def _lose_position(self) -> None:
        true = self.true
        self._machine = dict.fromkeys(self._machine, 0.0)
        self.slip = true
        self._boot()

    def _kill(self, lost: float) -> None:
        """Stop dead; a motor that was moving loses steps."""
        if self.moving:
            for letter in self.slip:
                self.slip[letter] += lost
        self._legs.clear()
        self._homing_run += 1

    def _reset(self) -> None:
        homing = self.state == "Home"
        if self.moving:
            self._kill(0.7)
            self.state = "Alarm"
            self.say(b"ALARM:6\r\n" if homing else b"ALARM:3\r\n")
        run = self._homing_run
        self._begin()
        self._homing_run = run
        if self.state != "Alarm":
            self.state = "Idle"
        self._greet()

    def _hold(self) -> None:
        if self.state == "Idle":
            self.state, self.phase = "Hold", 0
        elif self.state in ("Jog", "Run") and self.phase == 0:
            leg = self._legs[0]
            here = leg.where(self.now())
            rest = leg.length - (self.now() - leg.at) * leg.speed
            length = min(rest, leg.speed**2 / 2 / float(self.settings[120]))
            share = length / rest if rest > 0 else 0.0
            end = {letter: at + share * (leg.end[letter] - at) for letter, at in here.items()}
            self._cancelling, self.phase = self.state == "Jog", 1
            self._remainder = [] if self._cancelling else [leg.end for leg in self._legs]
            self._legs = deque([Leg(here, end, leg.speed / 2, self.now())])
            if not self._cancelling:
                self.state = "Hold"

    def _resume(self) -> None:
        if self.state == "Hold" and self.phase == 0:
            self.state = "Run" if self._remainder else "Idle"
            for end in self._remainder:
                self._enqueue(end, 10.0)

    def _advance(self) -> None:
        now = self.now()
        while (self._legs and self.state != "Hold") or self.phase == 1:
            leg = self._legs[0]
            self._machine = leg.where(now)
            if now < leg.until:
                return
            self._legs.popleft()
            if self.phase == 1:
                self.phase = 0
                self._legs.clear()
                if self._cancelling:
                    self.state = "Idle"
                return
            if self._legs:
                self._legs[0].at = leg.until
            else:
                self.state = "Idle"

    def _enqueue(self, to: Angles, speed: float) -> None:
        start = self._legs[-1].end if self._legs else self._machine
        end = {letter: round(to.get(letter, at) * 160) / 160 for letter, at in start.items()}
        leg = Leg(dict(start), end, speed, self.now())
        if leg.length:
            self._legs.append(leg)

    def _report(self) -> bytes:
        held = f":{self.phase}" if self.state == "Hold" else ""
        x, y = self._machine["X"], self._machine["Y"]
        name = "MPos" if int(self.settings[10]) & 1 else "WPos"
        return f"<{self.state}{held}|{name}:{x:.3f},{y:.3f},0.000|FS:0,0>\r\n".encode()

    def _work(self) -> None:
        """Carry out lines; while it holds, homes or has a critical alarm they wait."""
        while self._lines and self.state not in ("Hold", "Home") and not self._critical and self.phase == 0:
            self._execute(self._lines.popleft())

    def _execute(self, line: str) -> None:
        self.commands.append(line)
        if line == "$$":
            self.say(
                "".join(f"${key}={value}\r\n" for key, value in self.settings.items()).encode() + b"ok\r\n"
            )
        elif line == "$I":
            self.say(self.build_info + b"ok\r\n")
        elif line == "$N":
            self.say("".join(f"$N{n}={at}\r\n" for n, at in enumerate(self.startup)).encode() + b"ok\r\n")
        elif line == "$G":
            self.say(b"[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n")
        elif line == "$":
            self.say(b"[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]\r\nok\r\n")
        elif line == "$H":
            self._home()
        elif line == "$X":
            self.state = "Idle" if self.state == "Alarm" else self.state
            self.say(b"[MSG:Caution: Unlocked]\r\nok\r\n")
        elif jog := JOG.fullmatch(line):
            self._jog(jog[1], float(jog[2]))
        else:
            self.say(b"error:9\r\n" if self.state == "Alarm" else b"error:20\r\n")

    def _jog(self, words: str, feed: float) -> None:
        if self.state not in ("Idle", "Jog"):
            self.say(b"error:9\r\n" if self.state == "Alarm" else b"error:8\r\n")
            return
        to = {word[0]: float(word[1:]) for word in words.split()}
        end = {**(self._legs[-1].end if self._legs else self._machine), **to}
        self.moves.append((radians(end["X"] + self.slip["X"]), radians(end["Y"] + self.slip["Y"])))
        self._enqueue(to, min(feed, float(self.settings[110])) / 60)
        if self._legs:
            self.state = "Jog"
        self.say(b"ok\r\n")

    def _home(self) -> None:
        if self.settings[22] != "1":
            self.say(b"error:5\r\n")
            return
        self.state = "Home"
        self._homing_run += 1
        run = self._homing_run
        self.moves.append((0.0, 0.0))
        self._due.append((self.now() + self.HOMING_SECONDS, lambda: self._homed(run)))

    def _homed(self, run: int) -> None:
        if run != self._homing_run or self.state != "Home":
            return
        for letter, travel in (("X", 130), ("Y", 131)):
            self._machine[letter] = -self.PULL_OFF  # off the switch at the end of the travel
            self.slip[letter] = float(self.settings[travel]) / 2
        self.state = "Idle"
        self.say(b"ok\r\n")
        self._work()
