"""How far and how fast the host lets a stage move."""

from math import radians, sqrt
from typing import Annotated

from pydantic import AfterValidator, Field

from drivers.device import BackendOptions
from drivers.position import Limits


def _about_zero(found: tuple[float, float]) -> tuple[float, float]:
    low, high = found
    if not (low <= 0.0 <= high and low < high):
        raise ValueError(f"expected a smallest angle of at most 0 and a largest of at least 0, got {found}")
    return found


_Turn = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
AngleRange = Annotated[tuple[_Turn, _Turn], AfterValidator(_about_zero)]
"""Smallest and largest angle, degrees; 0, where a stage is homed, lies between them."""


class MotionOptions(BackendOptions):
    """What a real stage may do; its own limits hold as well."""

    pan_limits: AngleRange = Field((-180.0, 180.0), description="Smallest and largest pan, degrees.")
    tilt_limits: AngleRange = Field((-90.0, 90.0), description="Smallest and largest tilt, degrees.")
    speed: float = Field(10.0, gt=0, le=360, description="Fastest of each axis, degrees per second.")
    acceleration: float = Field(20.0, gt=0, le=3600, description="Of each axis, degrees per s², at most.")

    @property
    def limits(self) -> Limits:
        """Radians."""
        pan, tilt = self.pan_limits, self.tilt_limits
        return Limits((radians(pan[0]), radians(pan[1])), (radians(tilt[0]), radians(tilt[1])))

    @property
    def radians_per_second(self) -> float:
        return radians(self.speed)

    @property
    def radians_per_second_squared(self) -> float:
        return radians(self.acceleration)


def duration(distance: float, speed: float, acceleration: float) -> float:
    """Seconds of a movement over `distance` with a trapezoidal course of speed; units as they fit."""
    if distance == 0:
        return 0.0
    if distance * acceleration < speed**2:
        return 2 * sqrt(distance / acceleration)
    return distance / speed + speed / acceleration
