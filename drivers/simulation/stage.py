"""A simulated rotation stage, with steps, speed and pointing errors."""

from math import inf, radians
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.position import Limits, Position
from drivers.simulation.motion import Axis
from drivers.stage import Stage


class StageOptions(BackendOptions):
    """How well the simulated stage is made."""

    resolution: float = Field(0.01, ge=0, le=5, description="Smallest step, degrees; 0 = continuous.")
    pointing_error: float = Field(
        0.003,
        ge=0,
        le=1,
        description="Standard deviation of where an axis really stops about where it reports, degrees.",
    )
    speed: float = Field(30.0, gt=0, le=1000, description="Of each axis, degrees per second.")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="Of the pointing errors.")


class SimulatedStage(Stage):
    """Moves at constant speed, stops at whole steps, and misses them by a small error it does not know of.

    The same seed gives the same errors after every `open`. Going where the stage already is moves nothing;
    at the start and after `home` the error is zero.
    """

    Options = StageOptions
    PAN_LIMIT, TILT_LIMIT = radians(159.0), radians(31.0)
    """A PTU-D46-17's ranges (factory limits 3090 and 604 steps of 185.14″), the tilt made symmetric."""

    options: StageOptions
    needs_consent: ClassVar[bool] = False

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._axes = Axis(), Axis()
        self._errors = np.random.default_rng(self.options.seed)

    def pose_at(self, timestamp: int) -> Position:
        """Where the stage truly pointed at a time in ns since the epoch, errors included."""
        pan, tilt = self._axes
        return Position(pan.true(timestamp), tilt.true(timestamp))

    def _open(self) -> None:
        self._axes = Axis(), Axis()
        self._errors = np.random.default_rng(self.options.seed)

    def _close(self) -> None:
        pass

    def _home(self) -> None:
        now = self.clock.now()
        for axis in self._axes:
            axis.go(now, 0.0, radians(self.options.speed), 0.0)

    def _homing(self) -> str:
        return "turns to 0°, 0°"

    def _move_to(self, pan: float, tilt: float) -> None:
        now = self.clock.now()
        # Drawn for both axes every time, so that the errors of a plan do not depend on which axes it moves.
        errors = self._errors.normal(0.0, radians(self.options.pointing_error), 2)
        for axis, angle, error in zip(self._axes, (pan, tilt), errors, strict=True):
            target = self._whole_steps(angle)
            if target != axis.commanded(max(now, axis.arrival)) or now < axis.arrival:
                axis.go(now, target, radians(self.options.speed), float(error))

    def _remaining(self) -> float:
        return max(0.0, (max(axis.arrival for axis in self._axes) - self.clock.now()) / 1e9)

    def _stop(self) -> None:
        now = self.clock.now()
        for axis in self._axes:
            axis.stop(now)

    def _position(self) -> Position:
        now = self.clock.now()
        pan, tilt = (self._whole_steps(axis.commanded(now)) for axis in self._axes)
        return Position(pan, tilt)

    def _limits(self) -> Limits:
        return Limits(pan=(-self.PAN_LIMIT, self.PAN_LIMIT), tilt=(-self.TILT_LIMIT, self.TILT_LIMIT))

    def _resolution(self) -> float:
        return radians(self.options.resolution)

    def _speed(self) -> float:
        return radians(self.options.speed)

    def _acceleration(self) -> float:
        return inf

    def _whole_steps(self, angle: float) -> float:
        step = radians(self.options.resolution)
        return round(angle / step) * step if step else angle
