"""No stage at all: a camera that stands still."""

from drivers.stage import Limits, Position, Stage


class FixedStage(Stage):
    """A mount that does not turn: always at (0, 0), and any other angle is beyond its limits."""

    def _open(self) -> None:
        pass

    def _close(self) -> None:
        pass

    def _home(self) -> None:
        pass

    def _move_to(self, pan: float, tilt: float) -> None:
        pass

    def _wait(self, timeout: float) -> None:
        pass

    def _position(self) -> Position:
        return Position(0.0, 0.0)

    def _limits(self) -> Limits:
        return Limits(pan=(0.0, 0.0), tilt=(0.0, 0.0))
