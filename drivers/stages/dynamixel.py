"""One or two Dynamixel X servos (protocol 2.0); their encoders are absolute within a turn."""

from __future__ import annotations

from math import copysign, radians, tau

from pydantic import Field, model_validator

from drivers.errors import DeviceLostError, InitialisationError, OperationError
from drivers.position import Limits, Position
from drivers.stages.dynamixel_axis import COUNTS_PER_TURN, Axis, check_drive, hardware_error, make_axis
from drivers.stages.dynamixel_bus import DynamixelBus, Motion
from drivers.stages.serial_stage import SerialOptions, SerialStage, Sign

POLL_SECONDS = 0.02
HALT_SECONDS = 2.0

VELOCITY_UNIT = 0.229 * 360 / 60
"""Degrees per second in one unit of the profile velocity, 0.229 rev/min."""

ACCELERATION_UNIT = 214.577 * 360 / 3600
"""Degrees per s² in one unit of the profile acceleration, 214.577 rev/min²."""

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
    speed: float = Field(
        10.0, ge=VELOCITY_UNIT, le=360, description="Fastest of each axis, degrees per second."
    )
    acceleration: float = Field(
        22.0, ge=ACCELERATION_UNIT, le=3600, description="Of each axis, degrees per s², at most."
    )

    @model_validator(mode="after")
    def _has_two_servos(self) -> DynamixelOptions:
        if self.pan_id == self.tilt_id:
            raise ValueError(f"pan_id and tilt_id are both {self.pan_id}; each axis has a servo of its own")
        return self


class DynamixelStage(SerialStage):
    """One or two servos. What they keep in EEPROM, such as their operating mode, is not changed here.

    A servo that is limp when it is opened stays so until the first movement, which gives it its own position
    as goal before its torque is switched on.
    """

    Options = DynamixelOptions
    options: DynamixelOptions

    def _greet(self) -> None:
        self._bus = DynamixelBus(self._line, self.clock)
        try:
            self._learn()
        except DeviceLostError as error:
            raise InitialisationError(str(error)) from error
        self._declare_known()
        self._stop()  # it may still be on its way to where an earlier run has sent it

    def _learn(self) -> None:
        self._goals: dict[ServoId, int] = {}
        self._seen: dict[ServoId, tuple[int, int]] = {}
        self._held: set[ServoId] = set()
        options = self.options
        self._velocity = int(options.speed / VELOCITY_UNIT)
        self._pan = self._axis(options.pan_id, options.pan_zero, options.pan_sign)
        self._tilt = (
            None
            if options.tilt_id is None
            else self._axis(options.tilt_id, options.tilt_zero, options.tilt_sign)
        )
        self._axes = [axis for axis in (self._pan, self._tilt) if axis is not None]

    def _axis(self, servo: ServoId, zero: int, sign: Sign) -> Axis:
        self._bus.ping(servo)
        drive, condition = self._bus.drive(servo), self._bus.condition(servo)
        check_drive(self._line.name, servo, drive, condition)
        self._velocity = min(self._velocity, drive.velocity)
        if condition.torque:
            self._held.add(servo)
        return make_axis(self._line.name, servo, zero, sign, drive, self._bus.motion(servo).position)

    def _limits(self) -> Limits:
        return Limits(pan=self._pan.limits, tilt=self._tilt.limits if self._tilt else (0.0, 0.0))

    def _resolution(self) -> float:
        return tau / COUNTS_PER_TURN

    def _speed(self) -> float:
        return radians(self._velocity * VELOCITY_UNIT)

    def _acceleration(self) -> float:
        return radians(self._profile_acceleration * ACCELERATION_UNIT)

    @property
    def _profile_acceleration(self) -> int:
        return int(self.options.acceleration / ACCELERATION_UNIT)

    def _move_to(self, pan: float, tilt: float) -> None:
        for axis in self._axes:
            self._hold(axis)
        for axis, angle in zip(self._axes, (pan, tilt), strict=False):
            self._go(axis, axis.counts(angle))

    def _go(self, axis: Axis, goal: int) -> None:
        self._set_out(axis, goal)
        self._bus.go(axis.servo, self._profile_acceleration, self._velocity, goal)

    def _set_out(self, axis: Axis, goal: int) -> None:
        """Note the goal, and where the servo must be when it is sent there."""
        if axis.servo in self._seen:
            self._seen[axis.servo] = self.clock.now(), self._reckoned(axis).position
        self._goals[axis.servo] = goal

    def _go_confirmed(self, axis: Axis, goal: int) -> None:
        self._go(axis, goal)
        if self._bus.goal(axis.servo) != (self._velocity, goal):
            raise OperationError(f"{self._line.name}: Dynamixel {axis.servo} does not take its goal")

    def _hold(self, axis: Axis) -> None:
        """Make sure that the servo holds its axis: it must not start towards an older goal."""
        self._raise_if_alarmed(axis.servo)
        if axis.servo in self._goals:
            self._raise_if_let_go(axis.servo)
            return
        self._go_confirmed(axis, axis.nearest(self._motion(axis).position))
        self._bus.hold(axis.servo)
        self._held.add(axis.servo)
        self._raise_if_let_go(axis.servo)

    def _raise_if_alarmed(self, servo: ServoId) -> None:
        found = self._bus.condition(servo).hardware_error
        if found or servo in self._bus.alerted:
            raise OperationError(
                f"{self._line.name}: Dynamixel {servo} has raised a hardware alert ({hardware_error(found)}) "
                "and may have let go; remove the cause and power it anew"
            )

    def _raise_if_let_go(self, servo: ServoId) -> None:
        """A restart shows by the torque, and by a profile that is not what was written."""
        held = self._bus.condition(servo).torque
        if not held or self._bus.goal(servo) != (self._velocity, self._goals[servo]):
            raise DeviceLostError(
                f"{self._line.name}: Dynamixel {servo} has restarted or lets go of its axis; close it and "
                "open it again"
            )

    def _motion(self, axis: Axis) -> Motion:
        found = self._bus.motion(axis.servo)
        self._seen[axis.servo] = self.clock.now(), found.position
        return found

    def _remaining(self) -> float:
        arrived = [self._has_arrived(axis) for axis in self._axes]
        if not self.needs_home:  # what is turned back from beyond its limits is on its way
            self.limits.check_reported(
                self._pointing([self._seen[axis.servo][1] for axis in self._axes]), str(self)
            )
        return 0.0 if all(arrived) else POLL_SECONDS

    def _has_arrived(self, axis: Axis) -> bool:
        goal = self._goals.get(axis.servo)
        if goal is None:
            return True
        found = self._motion(axis)
        if axis.servo in self._bus.alerted:
            self._raise_if_alarmed(axis.servo)
        if found.moving:
            return False
        self._raise_if_let_go(axis.servo)
        return abs(found.position - goal) <= self.options.tolerance

    def _stop(self) -> None:
        held = [axis for axis in self._axes if axis.servo in self._held]
        found = self._whereabouts(held)
        halted = [
            axis for axis, motion in zip(held, found, strict=True) if self._is_off_its_goal(axis, motion)
        ]
        for axis in halted:
            self._bus.send(axis.servo, self._profile_acceleration, self._velocity, self._goals[axis.servo])
        for axis in halted:
            self._go_confirmed(axis, self._goals[axis.servo])
        deadline = self.clock.now() + round(HALT_SECONDS * 1e9)
        while any(self._motion(axis).moving for axis in halted):
            if self.clock.now() >= deadline:
                raise OperationError(
                    f"{self}: the servos still move {HALT_SECONDS:g} s after they were halted"
                )
            self.clock.sleep(POLL_SECONDS)

    def _whereabouts(self, axes: list[Axis]) -> list[Motion]:
        """Where the servos say they are or, where the line is slow, where they must be by now."""
        answers, found = True, []
        for axis in axes:
            motion = self._bus.glance(axis.servo) if answers else None
            answers = motion is not None
            if motion is not None:
                self._seen[axis.servo] = self.clock.now(), motion.position
            elif axis.servo in self._seen:
                motion = self._reckoned(axis)
            found.append(motion or self._motion(axis))
        return found

    def _is_off_its_goal(self, axis: Axis, found: Motion) -> bool:
        """Whether a servo moves, or is held off its goal; where it is becomes its goal then."""
        goal = self._goals.get(axis.servo)
        if goal is None:
            goal = self._bus.goal(axis.servo)[1]
        off = found.moving or abs(found.position - goal) > self.options.tolerance
        if off:
            here = self._reckoned(axis) if found.moving else found
            self._set_out(axis, axis.nearest(here.position))
        return off

    def _reckoned(self, axis: Axis) -> Motion:
        at, position = self._seen[axis.servo]
        rest = self._goals.get(axis.servo, position) - position
        travelled = (self.clock.now() - at) * 1e-9 * self._velocity * VELOCITY_UNIT * COUNTS_PER_TURN / 360
        return Motion(rest != 0, position + round(copysign(min(abs(rest), travelled), rest)))

    def _position(self) -> Position:
        return self._pointing([self._motion(axis).position for axis in self._axes])

    def _pointing(self, counts: list[int]) -> Position:
        angles = [axis.angle(at) for axis, at in zip(self._axes, counts, strict=True)]
        return Position(angles[0], angles[1] if self._tilt else 0.0)

    def _home(self) -> None:
        """The encoder knows its place within the turn; what a restart has changed is learnt anew."""
        self._learn()

    def _homing(self) -> str:
        return "turns to 0°, 0°"
