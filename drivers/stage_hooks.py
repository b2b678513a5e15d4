"""What a stage backend has to know how to do; `Stage` calls it at the right time."""

from abc import abstractmethod

from drivers.device import Device
from drivers.motion import MotionOptions
from drivers.position import Limits, Position


class StageHooks(Device):
    """The hooks of a backend. `_open` moves nothing; what waits in a hook does so by `Stage._pause`."""

    @abstractmethod
    def _home(self) -> None:
        """Find the reference; the base then goes to (0, 0). Pauses by `_pause`."""

    @abstractmethod
    def _homing(self) -> str:
        """What `_home` does, as in "runs both axes into their stops, then turns to 0°, 0°"."""

    @abstractmethod
    def _move_to(self, pan: float, tilt: float) -> None:
        """Start to move, no faster than `_speed`, to angles that are within the limits."""

    @abstractmethod
    def _remaining(self) -> float:
        """Seconds until it is worth asking again; 0 = stands at its target. Raises what went wrong."""

    @abstractmethod
    def _stop(self) -> None:
        """Send the halt first, whatever state the line is in; leave nothing queued; make sure it stands.

        Declares the position unknown where the halt may have cost it.
        """

    @abstractmethod
    def _position(self) -> Position:
        """What the stage reports."""

    @abstractmethod
    def _limits(self) -> Limits:
        """The stage's own limits."""

    def _resolution(self) -> float:
        return 0.0

    def _speed(self) -> float:
        """rad/s; what is in force, at most what the options say."""
        assert isinstance(self.options, MotionOptions)
        return self.options.radians_per_second

    def _acceleration(self) -> float:
        """rad/s²; what is in force, at most what the options say."""
        assert isinstance(self.options, MotionOptions)
        return self.options.radians_per_second_squared
