"""What a Grbl 1.1 controller says, and what its numbers mean (gnea/grbl, doc/markdown/interface.md)."""

from __future__ import annotations

import re
from dataclasses import dataclass

LOCKED = 9
"""The error after an alarm, until the axes are homed."""

ERRORS = {
    1: "a letter is missing",
    2: "a number is missing or malformed",
    3: "unknown $ command",
    5: "homing is off ($22=0)",
    8: "only possible while idle",
    LOCKED: "locked by an alarm: home it",
    15: "beyond the machine's travel",
    20: "unsupported command",
    22: "no feed rate",
}

ALARMS = {
    1: "a hard limit switch was hit",
    2: "the target is beyond the soft limits",
    3: "it was reset while moving",
    6: "it was reset while homing",
    7: "the safety door opened while homing",
    8: "homing could not clear the limit switch",
    9: "homing did not find the limit switch",
}

BANNER = re.compile(r"Grbl\w* +\d+\.\d+")
ANSWER = re.compile(r"^(?:(ok)|error:(\d+))$")
"""Nothing else in its line: the echo of a startup line ends in `:ok`."""

ALARM = re.compile(r"ALARM:(\d+)$")
SETTING = re.compile(r"^\$(\d+)=([+-]?\d+(?:\.\d+)?)$")
STARTUP_LINE = re.compile(r"^\$N\d=(.*)$")
VERSION = re.compile(r"^\[VER:(\d+)\.(\d+)")
BUILD_OPTIONS = re.compile(r"^\[OPT:([^,\]]*)")
_REPORT = re.compile(r"<([A-Za-z]+)(?::(\d+))?((?:\|[^|<>]*)*)>")

AXES = 3
Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Status:
    """One status report.

    Attributes:
        state: Idle, Run, Hold, Jog, Alarm, Door, Check, Home or Sleep.
        phase: of a hold (0 = stands, 1 = comes to a stop) or of a door (0, 1 = stands); else 0.
        machine: machine position of each axis; empty where work positions are reported ($10).
    """

    state: str
    phase: int
    machine: Vector

    @property
    def stands(self) -> bool:
        """Whether nothing moves."""
        return self.state not in ("Run", "Jog", "Home") and self.phase <= (self.state == "Door")


def parse_status(line: str) -> Status | None:
    """The status report in a line; None where there is none, or noise has spoilt it."""
    found = _REPORT.search(line)
    if found is None:
        return None
    fields = dict(field.partition(":")[::2] for field in found[3].split("|") if field)
    try:
        machine = tuple(float(value) for value in fields["MPos"].split(",")) if "MPos" in fields else ()
    except ValueError:
        return None
    if len(machine) < AXES and "WPos" not in fields:
        return None
    return Status(found[1], int(found[2] or 0), machine)
