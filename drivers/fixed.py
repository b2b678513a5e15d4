"""No stage at all: a camera that stands still."""

from math import inf
from typing import ClassVar

from drivers.position import Limits, Position
from drivers.stage import Stage


class FixedStage(Stage):
    """A mount that does not turn: always at (0, 0), and any other angle is beyond its limits."""

    needs_consent: ClassVar[bool] = False

    def _open(self) -> None:
        pass

    def _close(self) -> None:
        pass

    def _home(self) -> None:
        pass

    def _homing(self) -> str:
        return "moves nothing"

    def _move_to(self, pan: float, tilt: float) -> None:
        pass

    def _remaining(self) -> float:
        return 0.0

    def _stop(self) -> None:
        pass

    def _position(self) -> Position:
        return Position(0.0, 0.0)

    def _limits(self) -> Limits:
        return Limits(pan=(0.0, 0.0), tilt=(0.0, 0.0))

    def _speed(self) -> float:
        return inf

    def _acceleration(self) -> float:
        return inf
