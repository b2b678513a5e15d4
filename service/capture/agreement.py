"""Whether a stage reports to have been where a burst's plan sent it."""

from collections.abc import Sequence
from math import degrees, radians

from drivers.position import Position
from service.errors import MotionError

_STEPS = 3.0
"""Steps of the stage that a plan must span for its reports to be judged."""

_SAG = radians(0.5)
"""By how much every report may be off: a loaded servo sags."""


def require_agreement(
    stage: str, sent: Sequence[Position], reported: Sequence[Position], resolution: float
) -> None:
    """Raise `MotionError` where a stage said that it arrived, but reports to have been elsewhere.

    Along an axis it has to report half of the plan's span at least, and no angle further off than that span.

    Args:
        stage: how it is called.
        sent: pose of each frame by the plan.
        reported: pose of each frame as the stage told it.
        resolution: its smallest step, radians.
    """
    for axis in ("pan", "tilt"):
        told = [getattr(position, axis) for position in sent]
        found = [getattr(position, axis) for position in reported]
        span = max(told) - min(told)
        off = max(abs(one - other) for one, other in zip(told, found, strict=True))
        still = span > _STEPS * resolution and max(found) - min(found) < span / 2
        if still or off > span + _SAG:
            raise MotionError(
                f"{stage} was sent to {axis} {_range(told)} and said that it arrived, but reports "
                f"{_range(found)}: look at its encoder, its cable and its settings; it stands still until "
                "started again"
            )


def _range(angles: Sequence[float]) -> str:
    return f"{degrees(min(angles)):.3f}° to {degrees(max(angles)):.3f}°"
