"""Rotary axes on a Grbl 1.1 controller, whose millimetres are taken as degrees.

Grbl has to be set up once by its owner: `$100` steps per degree, `$110` degrees per minute, `$120` degrees
per s², `$130` travel in degrees (and `$101`, … for the second axis). Nothing here writes its EEPROM.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, radians
from typing import Literal

from pydantic import Field

from drivers.errors import InitialisationError, LimitError, OperationError
from drivers.position import Limits, Position
from drivers.stages.grbl_dialogue import GrblDialogue
from drivers.stages.grbl_messages import BUILD_OPTIONS, SETTING, Vector
from drivers.stages.serial_stage import SerialOptions, SerialStage, Sign

AxisName = Literal["X", "Y", "Z"]

POLL_SECONDS = 0.2
"""Grbl's manual asks for no more than five status reports a second."""


class GrblOptions(SerialOptions):
    """Where the controller is connected and which of its axes turn what."""

    baud_rate: int = Field(115200, ge=300, le=4_500_000, description="Bits per second.")
    pan_axis: AxisName = Field("X", description="Axis that turns left and right.")
    tilt_axis: AxisName | None = Field(None, description="Axis that turns up and down; none = pan only.")
    pan_sign: Sign = Field(1, description="1 where the axis counts upwards to the left, else -1.")
    tilt_sign: Sign = Field(1, description="1 where the axis counts upwards when it turns up, else -1.")
    pan_zero: float | None = Field(
        None, description="Machine position of pan 0°, degrees; none = the middle of the travel."
    )
    tilt_zero: float | None = Field(
        None, description="Machine position of tilt 0°, degrees; none = the middle of the travel."
    )
    home_timeout: float = Field(60.0, gt=0, le=600, description="Seconds that the homing cycle may take.")


@dataclass(frozen=True, slots=True)
class Axis:
    """How one angle maps to one axis: machine degrees = zero + sign · angle; limits of the angle, degrees."""

    letter: AxisName
    steps: float
    zero: float
    sign: Sign
    low: float
    high: float

    @property
    def index(self) -> int:
        return "XYZ".index(self.letter)

    @property
    def limits(self) -> tuple[float, float]:
        """Radians."""
        return radians(self.low), radians(self.high)

    def target(self, angle: float) -> float:
        """Machine degrees of an angle in radians, on whole steps."""
        return self.on_steps(self.zero + self.sign * degrees(angle))

    def angle(self, machine: Vector) -> float:
        """Radians; Grbl reports three decimals, from which the whole steps are recovered."""
        return self.sign * radians(self.on_steps(machine[self.index]) - self.zero)

    def on_steps(self, machine: float) -> float:
        return round(machine * self.steps) / self.steps


class GrblStage(SerialStage):
    """One or two rotary axes.

    With limit switches (`$22=1`) it has to be homed after each opening, which resets most boards. Without
    them, pan and tilt are 0 where the axes stood when the controller was powered or reset.
    """

    Options = GrblOptions
    options: GrblOptions

    def _greet(self) -> None:
        self._target: tuple[float, float] | None = None
        self._grbl = GrblDialogue(self._line, self.clock)
        self._grbl.greet()
        found = (SETTING.search(line) for line in self._grbl.command("$$"))
        settings = {int(setting[1]): float(setting[2]) for setting in found if setting}
        self._has_switches = settings.get(22) == 1
        positive = self._positive_axes(settings) if self._has_switches else 0
        options = self.options
        self._pan = self._axis(options.pan_axis, options.pan_sign, options.pan_zero, settings, positive)
        self._tilt = options.tilt_axis and self._axis(
            options.tilt_axis, options.tilt_sign, options.tilt_zero, settings, positive
        )
        if self._has_switches or self._grbl.status().state == "Alarm":
            self._declare_unknown("the controller was reset when its port was opened")
        else:
            self._set_modes()

    def _positive_axes(self, settings: Mapping[int, float]) -> int:
        """Bit mask of the axes that count upwards from 0 after homing; all others end at 0.

        Only a Grbl built to set its origin there (option Z) follows the homing direction `$23`.
        """
        found = (BUILD_OPTIONS.search(line) for line in self._grbl.command("$I"))
        if any(build and "Z" in build[1] for build in found):
            return int(settings.get(23, 0))
        return 0

    def _axis(
        self,
        letter: AxisName,
        sign: Sign,
        zero: float | None,
        settings: Mapping[int, float],
        positive: int,
    ) -> Axis:
        index = "XYZ".index(letter)
        steps, travel = settings.get(100 + index, 0.0), settings.get(130 + index, 0.0)
        if steps <= 0 or travel <= 0:
            raise InitialisationError(
                f"{self._line.name}: Grbl has no steps per degree (${100 + index}) or no travel "
                f"(${130 + index}) for axis {letter}; set them with a terminal"
            )
        if not self._has_switches:
            low, high = -travel / 2, travel / 2
        else:
            low, high = (0.0, travel) if positive >> index & 1 else (-travel, 0.0)
        zero = (low + high) / 2 if zero is None else zero
        reach = sorted((sign * (low - zero), sign * (high - zero)))
        return Axis(letter, steps, zero, sign, reach[0], reach[1])

    def _set_modes(self) -> None:
        self._grbl.command("G21 G90 G94")

    def _limits(self) -> Limits:
        return Limits(pan=self._pan.limits, tilt=self._tilt.limits if self._tilt else (0.0, 0.0))

    def _resolution(self) -> float:
        return max(radians(1 / axis.steps) for axis in (self._pan, self._tilt) if axis)

    def _move_to(self, pan: float, tilt: float) -> None:
        self._arrived = 0
        self._target = self._pan.target(pan), self._tilt.target(tilt) if self._tilt else 0.0
        # G53: machine coordinates, whatever work offset an earlier program has left behind.
        words = [f"G53 G0 {self._pan.letter}{self._target[0]:.4f}"]
        if self._tilt:
            words.append(f"{self._tilt.letter}{self._target[1]:.4f}")
        self._grbl.command(" ".join(words))

    def _remaining(self) -> float:
        """Idle at the target twice in a row: the first idle may precede the movement."""
        if self._target is None:
            return 0.0
        status = self._grbl.status()
        self._raise_if_locked(status.state)
        assert status.machine is not None
        there = status.state == "Idle" and self._is_there(status.machine)
        self._arrived = self._arrived + 1 if there else 0
        return 0.0 if self._arrived == 2 else POLL_SECONDS

    def _stop(self) -> None:
        self._line.send(b"!")

    def _homing(self) -> str:
        return "homes"

    def _raise_if_locked(self, state: str) -> None:
        if state in ("Alarm", "Sleep"):
            raise LimitError(f"{self._line.name}: Grbl is in state {state} and has locked its axes; home it")

    def _is_there(self, machine: Vector) -> bool:
        assert self._target is not None
        axes = zip((self._pan, self._tilt), self._target, strict=True)
        # Half a step, and half of the third decimal, in which Grbl reports.
        return all(abs(machine[axis.index] - at) < 0.5 / axis.steps + 0.0005 for axis, at in axes if axis)

    def _position(self) -> Position:
        status = self._grbl.status()
        self._raise_if_locked(status.state)
        assert status.machine is not None
        return Position(
            self._pan.angle(status.machine), self._tilt.angle(status.machine) if self._tilt else 0.0
        )

    def _home(self) -> None:
        if not self._grbl.reset():  # the only way out of an alarm for a limit
            raise OperationError(f"{self._line.name}: the controller did not come back from its reset")
        self._grbl.command("$H" if self._has_switches else "$X", self.options.home_timeout, attempts=1)
        self._set_modes()
        self._target = None
