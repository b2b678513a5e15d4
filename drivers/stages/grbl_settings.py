"""What is set in a Grbl controller's EEPROM, and whether a stage can be moved by it safely.

Nothing here writes it: what is wrong is said, with the line that mends it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from drivers.errors import InitialisationError
from drivers.stages.grbl_dialogue import GrblDialogue
from drivers.stages.grbl_messages import BUILD_OPTIONS, SETTING, STARTUP_LINE, VERSION

IDLE_DELAY, REPORT_MASK, REPORT_INCHES, HOMING, HOMING_DIRECTION, HOMING_FEED, HOMING_SEEK = (
    1,
    10,
    13,
    22,
    23,
    24,
    25,
)
STEPS, RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130
"""Of axis X; Y and Z follow."""

ALWAYS_ON = 255
"""Milliseconds after a movement that stand for: the motors are never switched off."""

MOVES = re.compile(r"[XYZABC]|G0*(28|30)(?![.\d])", re.IGNORECASE)
ATTEMPTS = 4


class GrblSettings:
    """The settings of one controller.

    Args:
        values: number of a setting → its value.
        name: how the controller is called in messages.
        build: letters of its build options.
    """

    def __init__(self, values: Mapping[int, float], name: str, build: str = "") -> None:
        self._values, self._name, self._build = values, name, build

    def __getitem__(self, number: int) -> float:
        if number not in self._values:
            raise InitialisationError(
                f"{self._name}: Grbl does not say its setting ${number}; is it Grbl 1.1?"
            )
        return self._values[number]

    @property
    def has_switches(self) -> bool:
        """Whether it finds its position by limit switches."""
        return self[HOMING] == 1

    def is_positive(self, index: int) -> bool:
        """Whether an axis counts upwards from 0 after homing; by default it ends at 0.

        Only a Grbl built to set its origin there (option Z) follows the homing direction.
        """
        return "Z" in self._build and bool(int(self[HOMING_DIRECTION]) >> index & 1)

    def check(self, indices: Iterable[int], speed: float, acceleration: float) -> None:
        """Raise `InitialisationError` for what would make angles wrong or movements faster than allowed.

        Args:
            indices: the axes in use, 0 = X.
            speed: allowed, degrees per second.
            acceleration: allowed, degrees per s².
        """
        self._require(self[REPORT_INCHES] == 0, REPORT_INCHES, "0", "it reports inches")
        self._require(int(self[REPORT_MASK]) & 1 == 1, REPORT_MASK, "1", "it reports work positions")
        self._require(
            self[IDLE_DELAY] == ALWAYS_ON, IDLE_DELAY, str(ALWAYS_ON), "its motors let go between movements"
        )
        for index in indices:
            letter = "XYZ"[index]
            for first, what in (
                (STEPS, "steps per degree"),
                (RATE, "degrees per minute"),
                (TRAVEL, "travel"),
            ):
                self._require(self[first + index] > 0, first + index, "…", f"axis {letter} has no {what}")
            found = self[ACCELERATION + index]
            self._require(
                0 < found <= acceleration,
                ACCELERATION + index,
                f"{acceleration:g}",
                f"axis {letter} accelerates by {found:g}°/s², more than the stage's `acceleration` allows",
            )
        if self.has_switches:
            for number in (HOMING_FEED, HOMING_SEEK):
                found = self[number]
                self._require(
                    0 < found <= 60 * speed,
                    number,
                    f"{60 * speed:g}",
                    f"it homes at {found / 60:g}°/s, faster than the stage's `speed` allows",
                )

    def _require(self, holds: bool, number: int, wanted: str, wrong: str) -> None:
        if not holds:
            raise InitialisationError(
                f"{self._name}: Grbl cannot be used as it is set up: {wrong} (${number}={self[number]:g}); "
                f"set ${number}={wanted} with a terminal"
            )


def read_settings(grbl: GrblDialogue, name: str) -> GrblSettings:
    """The settings, read until two readings agree: a line that noise has spoilt has no check sum.

    Raises:
        InitialisationError: another version; a startup line that moves an axis at each reset; or the readings
            do not agree.
    """
    build = _build(grbl.command("$I"), name)
    for line in grbl.command("$N"):
        found = STARTUP_LINE.search(line)
        if found and MOVES.search(found[1]):
            raise InitialisationError(
                f"{name}: Grbl moves by itself at each start ({line}); clear that line with a terminal"
            )
    before = None
    for _ in range(ATTEMPTS):
        values = {
            int(found[1]): float(found[2]) for line in grbl.command("$$") if (found := SETTING.search(line))
        }
        if values and values == before:
            return GrblSettings(values, name, build)
        before = values
    raise InitialisationError(f"{name}: Grbl's settings read differently each time; check the cable")


def _build(lines: list[str], name: str) -> str:
    versions = [found for line in lines if (found := VERSION.search(line))]
    if not versions or (int(versions[0][1]), int(versions[0][2])) < (1, 1) or int(versions[0][1]) > 1:
        raise InitialisationError(
            f"{name}: this is no Grbl 1.1 (it says {' '.join(lines) or 'nothing'!r}); version 1.1 is needed"
        )
    return "".join(found[1] for line in lines if (found := BUILD_OPTIONS.search(line)))
