"""Rotary axes on a Grbl 1.1 controller, whose millimetres are taken as degrees.

Grbl has to be set up once by its owner: `$1=255` (the motors keep hold), `$100` steps per degree, `$110`
degrees per minute, `$120` degrees per s², `$130` travel in degrees (and `$101`, … for the second axis).
Nothing here writes its EEPROM.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Literal

from pydantic import Field, model_validator

from drivers.errors import InitialisationError, LimitError, OperationError
from drivers.position import Limits, Position
from drivers.stages.grbl_dialogue import GrblDialogue
from drivers.stages.grbl_messages import Status, Vector
from drivers.stages.grbl_settings import ACCELERATION, RATE, STEPS, TRAVEL, GrblSettings, read_settings
from drivers.stages.serial_stage import SerialOptions, SerialStage, Sign

AxisName = Literal["X", "Y", "Z"]

POLL_SECONDS = 0.2
"""Grbl's manual asks for no more than five status reports a second."""

HALT_SECONDS = 2.0
"""What a halt may take beyond coming to a stop."""


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

    @model_validator(mode="after")
    def _has_two_axes(self) -> GrblOptions:
        if self.pan_axis == self.tilt_axis:
            raise ValueError(
                f"pan_axis and tilt_axis are both {self.pan_axis}; each turns by an axis of its own"
            )
        return self


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

    def at_zero(self, machine: Vector) -> Axis:
        """The same axis, which stands at 0°."""
        return replace(self, zero=self.on_steps(machine[self.index]))

    def on_steps(self, machine: float) -> float:
        return round(machine * self.steps) / self.steps


class GrblStage(SerialStage):
    """One or two rotary axes.

    Grbl knows its position only from when it was last homed or powered, and opening its port resets most
    boards: its position is unknown after each opening. With limit switches (`$22=1`) homing finds it; without
    them `home` takes where it stands for 0°, so somebody has to turn it there.
    """

    Options = GrblOptions
    options: GrblOptions

    def _greet(self) -> None:
        self._declare_unknown("Grbl may have been moved or reset before its port was opened")
        self._target: tuple[float, float] | None = None
        self._arrived = 0
        self._grbl = GrblDialogue(self._line, self.clock)
        self._grbl.greet()
        settings = read_settings(self._grbl, self._line.name)
        options = self.options
        letters = [letter for letter in (options.pan_axis, options.tilt_axis) if letter]
        indices = ["XYZ".index(letter) for letter in letters]
        settings.check(indices, options.speed, options.acceleration)
        self._has_switches = settings.has_switches
        self._rate = min(options.speed, *(settings[RATE + index] / 60 for index in indices))
        self._ramp = min(settings[ACCELERATION + index] for index in indices)
        self._pan = self._axis(options.pan_axis, options.pan_sign, options.pan_zero, settings)
        self._tilt = options.tilt_axis and self._axis(
            options.tilt_axis, options.tilt_sign, options.tilt_zero, settings
        )

    def _axis(self, letter: AxisName, sign: Sign, zero: float | None, settings: GrblSettings) -> Axis:
        index = "XYZ".index(letter)
        travel = settings[TRAVEL + index]
        if self._has_switches:
            low, high = (0.0, travel) if settings.is_positive(index) else (-travel, 0.0)
            zero = (low + high) / 2 if zero is None else zero
        elif zero is None:
            low, high, zero = -travel / 2, travel / 2, 0.0
        else:
            raise InitialisationError(
                f"{self._line.name}: axis {letter} cannot have its zero at {zero:g}: without limit switches "
                "($22=0) homing takes where it stands for 0°; leave out pan_zero and tilt_zero"
            )
        reach = sorted((sign * (low - zero), sign * (high - zero)))
        return Axis(letter, settings[STEPS + index], zero, sign, reach[0], reach[1])

    def _limits(self) -> Limits:
        return Limits(pan=self._pan.limits, tilt=self._tilt.limits if self._tilt else (0.0, 0.0))

    def _resolution(self) -> float:
        return max(radians(1 / axis.steps) for axis in (self._pan, self._tilt) if axis)

    def _speed(self) -> float:
        return radians(self._rate)

    def _acceleration(self) -> float:
        return radians(self._ramp)

    def _move_to(self, pan: float, tilt: float) -> None:
        """Jog: it can be cancelled with all that is queued, and says itself in which units and how fast."""
        self._arrived = 0
        self._target = self._pan.target(pan), self._tilt.target(tilt) if self._tilt else 0.0
        # G53: machine coordinates, whatever work offset an earlier program has left behind.
        words = [f"$J=G53 G90 G21 {self._pan.letter}{self._target[0]:.4f}"]
        if self._tilt:
            words.append(f"{self._tilt.letter}{self._target[1]:.4f}")
        self._grbl.command(" ".join([*words, f"F{60 * self._rate:.2f}"]))

    def _remaining(self) -> float:
        """Idle at the target twice in a row: the first idle may precede the movement."""
        if self._target is None:
            return 0.0
        status = self._status()
        if not self.needs_home:  # the switches may lie beyond the limits
            self.limits.check_reported(self._pointing(status.machine), str(self))
        there = status.state == "Idle" and self._is_there(status.machine)
        self._arrived = self._arrived + 1 if there else 0
        return 0.0 if self._arrived == 2 else POLL_SECONDS

    def _is_there(self, machine: Vector) -> bool:
        assert self._target is not None
        axes = zip((self._pan, self._tilt), self._target, strict=True)
        # Half a step, and half of the third decimal, in which Grbl reports.
        return all(abs(machine[axis.index] - at) < 0.5 / axis.steps + 0.0005 for axis, at in axes if axis)

    def _stop(self) -> None:
        self._target = None
        if not self._grbl.halt(self._halt_seconds) and not self.needs_home:
            self._declare_unknown("Grbl was halted by a reset while it moved: steps may be lost")

    @property
    def _halt_seconds(self) -> float:
        return self._rate / self._ramp + HALT_SECONDS

    def _position(self) -> Position:
        return self._pointing(self._status().machine)

    def _pointing(self, machine: Vector) -> Position:
        return Position(self._pan.angle(machine), self._tilt.angle(machine) if self._tilt else 0.0)

    def _status(self) -> Status:
        status = self._grbl.status()
        if status.state not in ("Idle", "Jog"):
            kind = LimitError if status.state in ("Alarm", "Sleep") else OperationError
            raise kind(
                f"{self._line.name}: Grbl is in state {status.state}, which was not asked for; home it"
            )
        return status

    def _home(self) -> None:
        on_its_way, self._target = self._target is not None and self._arrived < 2, None
        self._grbl.halt(self._halt_seconds)  # resets it, where an alarm for a limit has silenced it
        if self._has_switches:
            self._grbl.home(self.options.home_timeout)
            return
        if on_its_way:
            raise OperationError(
                f"{self}: it was on its way, and is stopped; turn it to 0° and home it again"
            )
        if self._grbl.status().state == "Alarm":
            self._grbl.command("$X")
        machine = self._status().machine
        self._pan = self._pan.at_zero(machine)
        self._tilt = self._tilt and self._tilt.at_zero(machine)

    @property
    def finds_reference(self) -> bool:
        return self._has_switches

    def _homing(self) -> str:
        if self._has_switches:
            return "drives the axes to their limit switches, then turns to 0°, 0°"
        return "takes where it stands for 0°, 0°, to which somebody has turned it; moves nothing"
