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

BANNER = re.compile(r"Grbl\w* +(\d+)\.(\d+)")
ANSWER = re.compile(r"(?:(ok)|error:(\d+))$")
ALARM = re.compile(r"ALARM:(\d+)$")
SETTING = re.compile(r"\$(\d+)=([+-]?\d+(?:\.\d+)?)")
BUILD_OPTIONS = re.compile(r"\[OPT:([^,\]]*)")
_REPORT = re.compile(r"<([A-Za-z]+)(?::\d+)?((?:\|[^|>]*)*)>")

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Status:
    """One status report.

    Attributes:
        state: Idle, Run, Hold, Jog, Alarm, Door, Check, Home or Sleep.
        machine: machine position of each axis, or None.
        work: work position of each axis, or None; machine = work + offset.
        offset: work coordinate offset, or None: it is reported now and then only.
    """

    state: str
    machine: Vector | None
    work: Vector | None
    offset: Vector | None


def parse_status(line: str) -> Status | None:
    """The status report in a line, or None where there is none or noise has spoilt it."""
    found = _REPORT.search(line)
    if found is None:
        return None
    fields = dict(field.partition(":")[::2] for field in found[2].split("|") if field)
    try:
        machine, work, offset = (_vector(fields.get(name)) for name in ("MPos", "WPos", "WCO"))
    except ValueError:
        return None
    return Status(found[1], machine, work, offset)


def _vector(text: str | None) -> Vector | None:
    return None if text is None else tuple(float(value) for value in text.split(","))
