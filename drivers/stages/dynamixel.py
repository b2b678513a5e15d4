"""One or two Dynamixel X servos (protocol 2.0); their encoders are absolute."""

from __future__ import annotations

from dataclasses import dataclass
from math import tau

from pydantic import Field

from drivers.errors import DeviceLostError, InitialisationError
from drivers.position import Limits, Position
from drivers.stages.dynamixel_bus import DynamixelBus
from drivers.stages.serial_stage import SerialOptions, SerialStage, Sign

COUNTS_PER_TURN = 4096
POSITION_MODES = {3: "position", 4: "extended position"}
POLL_SECONDS = 0.02

HOME_SECONDS = 60.0
"""A turn at the slowest useful profile velocity."""

# Control table of the X series: address, bytes.
OPERATING_MODE = 11, 1
MAX_POSITION = 48, 4
MIN_POSITION = 52, 4
TORQUE = 64, 1
GOAL_POSITION = 116, 4
MOVING = 122, 1
PRESENT_POSITION = 132, 4

ServoId = int


class DynamixelOptions(SerialOptions):
    """Where the servos are connected and how they are mounted."""

    baud_rate: int = Field(57600, ge=9600, le=4_500_000, description="Bits per second.")
    pan_id: ServoId = Field(1, ge=0, le=252, description="Servo that turns left and right.")
    tilt_id: ServoId | None = Field(
        None, ge=0, le=252, description="Servo that turns up and down; none = pan only."
    )
    pan_sign: Sign = Field(1, description="1 where the servo counts upwards to the left, else -1.")
    tilt_sign: Sign = Field(1, description="1 where the servo counts upwards when it turns up, else -1.")
    pan_zero: int = Field(2048, description="Position of pan 0°, counts of 360°/4096.")
    tilt_zero: int = Field(2048, description="Position of tilt 0°, counts of 360°/4096.")
    tolerance: int = Field(
        4, ge=0, le=64, description="Counts off its goal at which a loaded servo counts as arrived."
    )


@dataclass(frozen=True, slots=True)
class Axis:
    """How one angle maps to one servo: counts = zero + sign · angle; limits in radians."""

    servo: ServoId
    zero: int
    sign: Sign
    limits: tuple[float, float]

    def counts(self, angle: float) -> int:
        return self.zero + self.sign * round(angle * COUNTS_PER_TURN / tau)

    def angle(self, counts: int) -> float:
        return self.sign * (counts - self.zero) * tau / COUNTS_PER_TURN


class DynamixelStage(SerialStage):
    """One or two servos. Their operating mode is not changed here: it is kept in EEPROM."""

    Options = DynamixelOptions
    options: DynamixelOptions

    def _greet(self) -> None:
        self._bus = DynamixelBus(self._line, self.clock)
        self._goals: tuple[int, ...] | None = None
        options = self.options
        self._pan = self._axis(options.pan_id, options.pan_zero, options.pan_sign)
        self._tilt = (
            None
            if options.tilt_id is None
            else self._axis(options.tilt_id, options.tilt_zero, options.tilt_sign)
        )
        self._axes = [axis for axis in (self._pan, self._tilt) if axis is not None]
        self._hold()

    def _axis(self, servo: ServoId, zero: int, sign: Sign) -> Axis:
        try:
            self._bus.ping(servo)
            mode = self._bus.read(servo, *OPERATING_MODE)
            low, high = (self._bus.read(servo, *register) for register in (MIN_POSITION, MAX_POSITION))
        except DeviceLostError as error:
            raise InitialisationError(str(error)) from error
        if mode not in POSITION_MODES:
            raise InitialisationError(
                f"{self._line.name}: Dynamixel {servo} is in operating mode {mode}; set it to 3 (position) "
                "or 4 (extended position) with the maker's tool, torque off"
            )
        if mode == 4:  # the position limits do not apply; half a turn either way keeps cables whole
            low, high = zero - COUNTS_PER_TURN // 2, zero + COUNTS_PER_TURN // 2
        whole = Axis(servo, zero, sign, (0.0, 0.0))
        reach = sorted((whole.angle(low), whole.angle(high)))
        return Axis(servo, zero, sign, (reach[0], reach[1]))

    def _hold(self) -> None:
        for axis in self._axes:
            self._bus.write(axis.servo, *TORQUE, 1)

    def _limits(self) -> Limits:
        return Limits(pan=self._pan.limits, tilt=self._tilt.limits if self._tilt else (0.0, 0.0))

    def _resolution(self) -> float:
        return tau / COUNTS_PER_TURN

    def _move_to(self, pan: float, tilt: float) -> None:
        self._raise_if_let_go()
        self._goals = tuple(axis.counts(angle) for axis, angle in zip(self._axes, (pan, tilt), strict=False))
        for axis, goal in zip(self._axes, self._goals, strict=True):
            self._bus.write(axis.servo, *GOAL_POSITION, goal)

    def _raise_if_let_go(self) -> None:
        for axis in self._axes:
            if self._bus.read(axis.servo, *TORQUE) == 0:
                raise DeviceLostError(
                    f"{self._line.name}: Dynamixel {axis.servo} has restarted and lets go of its axis; close "
                    "it, open it again and home it"
                )

    def _remaining(self) -> float:
        return 0.0 if self._has_arrived() else POLL_SECONDS

    def _stop(self) -> None:
        for axis in self._axes:
            self._bus.write(axis.servo, *GOAL_POSITION, self._bus.read(axis.servo, *PRESENT_POSITION))

    def _homing(self) -> str:
        return "turns to 0°, 0°"

    def _has_arrived(self) -> bool:
        if self._goals is None:
            return True
        if any(self._bus.read(axis.servo, *MOVING) for axis in self._axes):
            return False
        counts = self._counts()
        return all(
            abs(at - goal) <= self.options.tolerance for at, goal in zip(counts, self._goals, strict=True)
        )

    def _counts(self) -> tuple[int, ...]:
        return tuple(self._bus.read(axis.servo, *PRESENT_POSITION) for axis in self._axes)

    def _position(self) -> Position:
        angles = [axis.angle(at) for axis, at in zip(self._axes, self._counts(), strict=True)]
        return Position(angles[0], angles[1] if self._tilt else 0.0)

    def _home(self) -> None:
        self._hold()
        self._goals = None
