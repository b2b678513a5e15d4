"""The base of every rotation stage backend."""

from abc import abstractmethod
from dataclasses import dataclass
from math import degrees, isfinite

from drivers.device import Device
from drivers.errors import LimitError


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
        for axis, angle, (low, high) in (("pan", pan, self.pan), ("tilt", tilt, self.tilt)):
            if not isfinite(angle) or not low <= angle <= high:
                raise LimitError(
                    f"{axis} {degrees(angle):.3f}° is outside this stage's limits "
                    f"{degrees(low):.3f}° to {degrees(high):.3f}°; nothing was sent: change the plan"
                )


class Stage(Device):
    """A rotation stage: closed, then open; angles in radians.

    A backend names its `Options` and fills the hooks (`_open`, `_close`, `_home`, `_move_to`, `_wait`,
    `_position`, `_limits`); state and limits are handled here.
    """

    def home(self) -> None:
        """Find the reference position and go to (0, 0); returns when done."""
        self._require_open("home")
        self._home()

    def move_to(self, pan: float, tilt: float) -> None:
        """Start to move to absolute angles in radians; `wait` for the end.

        Raises:
            LimitError: an angle outside the limits; nothing was sent.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("move")
        self._limits().check(pan, tilt)
        self._move_to(pan, tilt)

    def wait(self, timeout: float = 10.0) -> None:
        """Return when the movement has ended.

        Raises:
            DeviceTimeoutError: still moving after `timeout` seconds.
            LimitError: the stage ran into a limit on its way.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("wait for")
        self._wait(timeout)

    @property
    def position(self) -> Position:
        """Where the stage reports to be: its own steps, not what was asked."""
        self._require_open("read the position of")
        return self._position()

    @property
    def limits(self) -> Limits:
        """Angles that the stage accepts."""
        self._require_open("read the limits of")
        return self._limits()

    @abstractmethod
    def _home(self) -> None: ...

    @abstractmethod
    def _move_to(self, pan: float, tilt: float) -> None: ...

    @abstractmethod
    def _wait(self, timeout: float) -> None: ...

    @abstractmethod
    def _position(self) -> Position: ...

    @abstractmethod
    def _limits(self) -> Limits: ...
