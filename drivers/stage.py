"""The base of every rotation stage backend."""

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import degrees, isfinite

from drivers.clock import Clock
from drivers.device import BackendOptions, Device
from drivers.errors import DeviceLostError, LimitError, StateError


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
    `_position`, `_limits`); state and limits are handled here. After a fault that may have moved the stage
    unnoticed the position is unknown (`needs_home`), and only `home` makes it known again.
    """

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._unknown: str | None = None

    @property
    def needs_home(self) -> bool:
        """Whether the position is unknown: after a fault, or before a first homing. Survives `close`."""
        return self._unknown is not None

    def home(self) -> None:
        """Find the reference position and go to (0, 0); returns when done.

        Raises:
            DeviceTimeoutError: it did not come to its end; the position is unknown.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("home")
        self._declare_unknown("homing did not come to its end")
        self._home()
        self._unknown = None

    def move_to(self, pan: float, tilt: float) -> None:
        """Start to move to absolute angles in radians; `wait` for the end.

        Raises:
            LimitError: an angle outside the limits; nothing was sent.
            StateError: the position is unknown.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("move")
        self._limits().check(pan, tilt)
        with self._known("move"):
            self._move_to(pan, tilt)

    def wait(self, timeout: float = 10.0) -> None:
        """Return when the movement has ended.

        Raises:
            DeviceTimeoutError: still moving after `timeout` seconds, or not where it was sent.
            LimitError: the stage ran into a limit on its way; the position is unknown.
            StateError: the position is unknown.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("wait for")
        with self._known("wait for"):
            self._wait(timeout)

    @property
    def position(self) -> Position:
        """Where the stage reports to be: its own steps, not what was asked.

        Raises:
            StateError: the position is unknown.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("read the position of")
        with self._known("read the position of"):
            return self._position()

    @contextmanager
    def _known(self, action: str) -> Iterator[None]:
        if self._unknown is not None:
            raise StateError(
                f"cannot {action} this {type(self).__name__}, its position is unknown ({self._unknown}): "
                "home it first"
            )
        try:
            yield
        except (DeviceLostError, LimitError) as error:
            self._declare_unknown(str(error))
            raise

    def _declare_unknown(self, reason: str) -> None:
        self._unknown = reason

    @property
    def resolution(self) -> float:
        """Smallest step, radians, of the coarser axis; 0 = finer than matters."""
        self._require_open("read the resolution of")
        return self._resolution()

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

    def _resolution(self) -> float:
        return 0.0
