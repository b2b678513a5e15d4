"""Directed Perception / FLIR pan-tilt units: D46, D47, D48, D100, D300 and the E series."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, radians, sqrt

from pydantic import Field

from drivers.errors import DeviceTimeoutError, InitialisationError
from drivers.position import Limits, Position
from drivers.stages.ptu_dialogue import ANSWER_SECONDS, PtuDialogue
from drivers.stages.serial_stage import SerialOptions, SerialStage

MOVE_MARGIN_SECONDS = 5.0
"""What a movement may take beyond its computed duration."""


class PtuOptions(SerialOptions):
    """Where the unit is connected, and how patient to be with it."""

    startup_timeout: float = Field(
        30.0, gt=0, le=300, description="Seconds to wait for a unit that calibrates itself after power-up."
    )
    home_timeout: float = Field(60.0, gt=0, le=600, description="Seconds that a calibration move may take.")


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis as the unit describes it.

    Attributes:
        resolution: radians per position.
        low, high: limits, positions.
        speed, acceleration: positions/s and positions/s².
    """

    resolution: float
    low: int
    high: int
    speed: float
    acceleration: float

    def counts(self, angle: float) -> int:
        """The position nearest to an angle."""
        return round(angle / self.resolution)

    def seconds(self, distance: int) -> float:
        """Duration of a trapezoidal movement over `distance` positions."""
        if distance < self.speed**2 / self.acceleration:
            return 2 * sqrt(distance / self.acceleration)
        return distance / self.speed + self.speed / self.acceleration

    @property
    def limits(self) -> tuple[float, float]:
        """Radians."""
        return self.low * self.resolution, self.high * self.resolution


class PtuStage(SerialStage):
    """A pan-tilt unit. Its steppers run open loop: lost steps show only where an axis hits a limit."""

    Options = PtuOptions
    options: PtuOptions

    def _greet(self) -> None:
        self._target: tuple[int, int] | None = None
        self._unit = PtuDialogue(self._line, self.clock)
        self._unit.greet(self.options.startup_timeout)
        self._pan, self._tilt = self._describe("P"), self._describe("T")

    def _describe(self, letter: str) -> Axis:
        # The unit gives its resolution in arc seconds per position.
        resolution = radians(self._unit.query(f"{letter}R") / 3600)
        low, high, speed, acceleration = (self._unit.query(letter + what) for what in "NXSA")
        if resolution <= 0 or low >= high or speed <= 0 or acceleration <= 0:
            raise InitialisationError(
                f"{self._line.name}: the unit describes axis {letter} implausibly: resolution "
                f"{degrees(resolution):g}°, limits {low:g} to {high:g}, speed {speed:g}, acceleration "
                f"{acceleration:g}; check its settings with a terminal"
            )
        return Axis(resolution, round(low), round(high), speed, acceleration)

    def _limits(self) -> Limits:
        return Limits(pan=self._pan.limits, tilt=self._tilt.limits)

    def _resolution(self) -> float:
        return max(self._pan.resolution, self._tilt.resolution)

    def _move_to(self, pan: float, tilt: float) -> None:
        self._go(self._pan.counts(pan), self._tilt.counts(tilt))

    def _go(self, pan: int, tilt: int) -> None:
        here = self._counts()
        duration = max(self._pan.seconds(abs(pan - here[0])), self._tilt.seconds(abs(tilt - here[1])))
        self._unit.busy_until = self._deadline(duration + MOVE_MARGIN_SECONDS)
        self._target = pan, tilt
        self._unit.command(f"PP{pan}")
        self._unit.command(f"TP{tilt}")

    def _wait(self, timeout: float) -> None:
        if self._target is None:
            return
        deadline = min(self._deadline(timeout), self._unit.busy_until)
        done = self._unit.await_movement(deadline)
        if not done and self.clock.now() < self._unit.busy_until:
            raise DeviceTimeoutError(f"{self._line.name}: still moving after {timeout:g} s")
        self._confirm(max(deadline, self._deadline(ANSWER_SECONDS)))

    def _confirm(self, deadline: int) -> None:
        """Compare positions as integers until they agree; raise where they do not in time."""
        while (here := self._counts()) != self._target:
            if self.clock.now() >= deadline:
                raise DeviceTimeoutError(
                    f"{self._line.name}: the unit was sent to positions {self._target} and stands at {here}; "
                    "check that nothing blocks it, then home it"
                )
            self.clock.sleep(0.05)
        self._unit.busy_until = 0

    def _position(self) -> Position:
        pan, tilt = self._counts()
        return Position(pan * self._pan.resolution, tilt * self._tilt.resolution)

    def _counts(self) -> tuple[int, int]:
        return round(self._unit.query("PP")), round(self._unit.query("TP"))

    def _home(self) -> None:
        self._unit.reset(self.options.home_timeout)
        self._go(0, 0)
        self._wait(self.options.home_timeout)

    def _deadline(self, seconds: float) -> int:
        return self.clock.now() + round(seconds * 1e9)
