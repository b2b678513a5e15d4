"""Directed Perception / FLIR pan-tilt units: D46, D47, D48, D100, D300 and the E series."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, floor, radians

from pydantic import Field

from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import DeviceLostError, InitialisationError, LimitError, OperationError
from drivers.position import Limits, Position
from drivers.stages.ptu_dialogue import PtuDialogue
from drivers.stages.ptu_ear import EVENTS
from drivers.stages.serial_stage import SerialOptions, SerialStage

POLL_SECONDS = 0.05

ACCELERATION_SECONDS = 15.0
"""A new acceleration makes the unit compute its ramps anew, for several seconds (manual, 4.4.4)."""

READINGS = 6
"""Times that a position is read until it is the same twice."""

STOPPING_SECONDS = 3.0
"""What a ramp down may take."""


class PtuOptions(SerialOptions):
    """Where the unit is connected, what it may do, and how patient to be with it."""

    startup_timeout: float = Field(
        30.0, gt=0, le=300, description="Seconds to wait for a unit that calibrates itself after power-up."
    )
    home_timeout: float = Field(60.0, gt=0, le=600, description="Seconds that a calibration move may take.")


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis: radians per position; limits, positions; what is in force, positions/s and positions/s²."""

    letter: str
    resolution: float
    low: int
    high: int
    speed: int
    acceleration: float

    def counts(self, angle: float) -> int:
        """The position nearest to an angle."""
        return min(max(round(angle / self.resolution), self.low), self.high)

    @property
    def limits(self) -> tuple[float, float]:
        """Radians."""
        return self.low * self.resolution, self.high * self.resolution


class PtuStage(SerialStage):
    """A pan-tilt unit. Its steppers run open loop: lost steps show only where an axis hits a limit.

    A unit calibrates itself at power-up, unless that was switched off (`RD`); its position counts as known
    when it is opened, unless it moves then.
    """

    Options = PtuOptions
    options: PtuOptions

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._target: tuple[int, int] | None = None
        self._was_quiet = False

    def _greet(self) -> None:
        self._target = None
        self._unit = PtuDialogue(self._line, self.clock)
        if self._unit.halt_what_moves():
            self._declare_unknown(
                "the head moved when it was opened (an autoscan, or another program), and was halted"
            )
        if self._was_quiet and self._unit.echoed_at_first:
            self._declare_unknown("the unit has restarted while it was not listened to")
        self._unit.greet(self.options.startup_timeout)
        self._was_quiet = self._unit.is_quiet
        try:
            self._halt()
            if not self._unit.enforces_limits():
                self._unit.command("LE")
            if not self._unit.enforces_limits():
                raise InitialisationError(f"{self._line.name}: the unit does not enforce its limits (LE)")
            self._pan, self._tilt = self._set_up("P"), self._set_up("T")
        except (DeviceLostError, OperationError) as error:
            raise InitialisationError(
                f"{error} (while it was set up; speed and acceleration are among stage.options)"
            ) from error

    def _close(self) -> None:
        try:
            self._unit.listen()
        except LimitError as error:
            self._declare_unknown(str(error))
        except DeviceLostError:
            pass
        super()._close()

    def _set_up(self, letter: str) -> Axis:
        # The unit gives its resolution in arc seconds per position.
        resolution = radians(self._steady(f"{letter}R") / 3600)
        low, high, slowest, fastest = (self._steady(letter + what) for what in "NXLU")
        if resolution <= 0 or low >= high or not 0 < fastest >= slowest >= 0:
            raise InitialisationError(
                f"{self._line.name}: the unit describes axis {letter} implausibly: resolution "
                f"{degrees(resolution):g}°, limits {low:g} to {high:g}, speeds {slowest:g} to {fastest:g}; "
                "check its settings with a terminal"
            )
        speed = floor(min(self.options.radians_per_second / resolution, fastest))
        if speed < max(slowest, 1):
            raise InitialisationError(
                f"{self._line.name}: axis {letter} cannot turn as slowly as {self.options.speed:g}°/s; its "
                f"slowest is {degrees(resolution) * max(slowest, 1):.3f}°/s: raise stage.options.speed"
            )
        self._put(f"{letter}S", speed)
        acceleration = self._steady(f"{letter}A")
        wanted = floor(self.options.radians_per_second_squared / resolution)
        if acceleration > wanted:
            acceleration = self._put(f"{letter}A", wanted)
        return Axis(letter, resolution, round(low), round(high), speed, acceleration)

    def _steady(self, query: str) -> float:
        """A value that is the same twice: on a bad line a digit may be lost."""
        value = self._unit.query(query)
        for _ in range(READINGS):
            before, value = value, self._unit.query(query)
            if value == before:
                return value
        raise InitialisationError(f"{self._line.name}: {query} is another each time; check the cable")

    def _put(self, name: str, value: int) -> int:
        """Set a value and make sure that it is in force."""
        self._unit.command(f"{name}{value}", ACCELERATION_SECONDS if name[1] == "A" else 1.0)
        found = self._steady(name)
        if found != value:
            raise InitialisationError(
                f"{self._line.name}: {name} was set to {value}, and the unit has {found:g}; check its "
                "settings with a terminal"
            )
        return value

    def _limits(self) -> Limits:
        return Limits(pan=self._pan.limits, tilt=self._tilt.limits)

    def _resolution(self) -> float:
        return max(self._pan.resolution, self._tilt.resolution)

    def _speed(self) -> float:
        return max(axis.speed * axis.resolution for axis in (self._pan, self._tilt))

    def _acceleration(self) -> float:
        return min(axis.acceleration * axis.resolution for axis in (self._pan, self._tilt))

    def _move_to(self, pan: float, tilt: float) -> None:
        self._target = self._pan.counts(pan), self._tilt.counts(tilt)
        for axis in (self._pan, self._tilt):
            self._unit.command(f"{axis.letter}S{axis.speed}")  # again: others may have changed it
        for axis, counts in zip((self._pan, self._tilt), self._target, strict=True):
            self._unit.command(f"{axis.letter}P{counts}")

    def _remaining(self) -> float:
        if self._target is None:
            return 0.0
        here = self._glance()
        self.limits.check_reported(self._angles(here), str(self))
        return 0.0 if here == self._target and self._counts() == self._target else POLL_SECONDS

    def _stop(self) -> None:
        self._target = None
        self._halt()

    def _halt(self) -> None:
        """Halt until it stands: a halt may be lost, and a ramp takes its time."""
        deadline = self.clock.now() + round(STOPPING_SECONDS * 1e9)
        while True:
            for event in self._unit.halt():
                self._declare_unknown(f"{self._line.name}: {EVENTS[event]}; steps are lost")
            try:
                before = self._glance()
                self.clock.sleep(POLL_SECONDS)
                if self._glance() == before:
                    return
            except LimitError as error:
                self._declare_unknown(str(error))
            if self.clock.now() >= deadline:
                raise OperationError(f"{self._line.name}: the unit still moves after a halt; switch it off")

    def _position(self) -> Position:
        return self._angles(self._counts())

    def _angles(self, counts: tuple[int, int]) -> Position:
        return Position(counts[0] * self._pan.resolution, counts[1] * self._tilt.resolution)

    def _glance(self) -> tuple[int, int]:
        return round(self._unit.query("PP")), round(self._unit.query("TP"))

    def _counts(self) -> tuple[int, int]:
        """Where it stands, read until it is the same twice with nothing unexpected in between.

        An answer that came twice could be taken for the next answer to the same query, until that one comes.
        """
        for _ in range(READINGS):
            strays = self._unit.strays
            first, again = self._glance(), self._glance()
            if first == again and self._unit.strays == strays:
                return again
        if first != again:
            return again  # it moves
        raise DeviceLostError(f"{self._line.name}: too many answers that were not asked for; check the cable")

    def _home(self) -> None:
        self._target = None
        self._unit.reset(self.options.home_timeout)

    def _homing(self) -> str:
        return "runs both axes into both of their stops (the unit's calibration), then turns to 0°, 0°"
