"""Where a stage points, and where it may point."""

from dataclasses import dataclass
from math import degrees, isfinite, radians

from drivers.errors import LimitError

_SLACK = radians(0.5)
"""By how much a report may exceed a limit: a loaded servo sags, others stop on whole steps."""


@dataclass(frozen=True, slots=True)
class Position:
    """Stage angles in radians: pan > 0 turns left, tilt > 0 turns up, pan is the outer axis."""

    pan: float
    tilt: float


@dataclass(frozen=True, slots=True)
class Limits:
    """Smallest and largest angle of each axis, radians."""

    pan: tuple[float, float]
    tilt: tuple[float, float]

    def check(self, pan: float, tilt: float) -> None:
        """Raise `LimitError` unless both angles are finite and within the limits."""
        outside = self._outside(Position(pan, tilt), 0.0)
        if outside:
            raise LimitError(f"{outside}; nothing was sent: change the plan")

    def check_reported(self, position: Position, stage: str) -> None:
        """Raise `LimitError` where a stage reports that it stands clearly beyond the limits."""
        outside = self._outside(position, _SLACK)
        if outside:
            raise LimitError(
                f"{stage} reports that {outside}: it was turned by other means, or has lost count of its "
                "turns; turn it back by hand and home it"
            )

    def within(self, other: "Limits") -> "Limits":
        """What both allow."""
        return Limits(_overlap(self.pan, other.pan), _overlap(self.tilt, other.tilt))

    def _outside(self, position: Position, slack: float) -> str:
        axes = (("pan", position.pan, self.pan), ("tilt", position.tilt, self.tilt))
        for axis, angle, (low, high) in axes:
            if not isfinite(angle) or not low - slack <= angle <= high + slack:
                return (
                    f"{axis} {degrees(angle):.3f}° is outside this stage's limits {degrees(low):.3f}° to "
                    f"{degrees(high):.3f}°"
                )
        return ""


def _overlap(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return max(one[0], other[0]), min(one[1], other[1])
