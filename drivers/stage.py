"""The base of every rotation stage backend: what may move, how far, how fast, and when it must stop."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import degrees
from typing import ClassVar

from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    DriverError,
    InitialisationError,
    LimitError,
    MotionStoppedError,
    StateError,
)
from drivers.motion import MotionOptions, duration
from drivers.position import Limits, Position
from drivers.stage_hooks import StageHooks

_SLICE = 0.02
"""Seconds after which a pause looks whether it is interrupted: a halt must be out within 0.2 s."""

_HOMING_SECONDS = 30.0
"""What the way from the reference to (0, 0) may take beyond its computed duration."""

_log = logging.getLogger(__name__)


class Stage(StageHooks):
    """A rotation stage: closed, then open; angles in radians.

    A backend names its `Options` and fills `StageHooks`; state, limits, waiting, stopping are handled here.
    Opening moves nothing. A movement that fails in any way, by an exception of any kind, is stopped before
    the exception leaves. After a fault that may have moved the stage unnoticed, its position is unknown
    (`uncertainty` says why), and only `home` makes it known again.

    All methods belong to the thread that owns the stage; from elsewhere it is stopped by `interrupted`.
    """

    needs_consent: ClassVar[bool] = True
    """Whether a person or a camera can be hit: a real stage. Then nothing moves without consent."""

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self.interrupted: Callable[[], bool] = lambda: False
        """Asked all the time while the stage moves or is spoken to; true stops the movement."""
        self._unknown: str | None = None
        self._moving = self._ending = False
        self._due = 0

    def open(self) -> None:
        """As `Device.open`; moves nothing. Raises also `InitialisationError` for limits that exclude 0°."""
        if self.is_open:
            return
        super().open()
        limits = self.limits
        for axis, (low, high) in (("pan", limits.pan), ("tilt", limits.tilt)):
            if not low <= 0.0 <= high:
                self.close()
                raise InitialisationError(
                    f"{self}: {axis} may turn from {degrees(low):.3f}° to {degrees(high):.3f}°, without 0°, "
                    "where it is homed; set the stage's own limits about its zero"
                )

    def close(self) -> None:
        """As `Device.close`; a stage that still moves is stopped first."""
        if self.is_open:
            self._stop_movement()
        with self._undisturbed():
            super().close()

    @property
    def uncertainty(self) -> str | None:
        """Why the position is unknown; None where it is known. Survives `close`."""
        return self._unknown

    @property
    def needs_home(self) -> bool:
        """Whether the position is unknown."""
        return self._unknown is not None

    @property
    def homing(self) -> str:
        """What `home` will do, for the person who has to consent to it."""
        self._require_open("home")
        return self._homing()

    @property
    def finds_reference(self) -> bool:
        """Whether `home` finds the reference itself; if not, a person has to turn the stage there before."""
        return True

    def home(self) -> None:
        """Find the reference position and go to (0, 0); returns when done.

        Raises:
            DeviceTimeoutError: it did not come to its end; the position is unknown.
            LimitError: it reports an angle beyond its limits; the position is unknown.
            MotionStoppedError: it was interrupted; the position is unknown.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("home")
        self._declare_unknown("homing did not come to its end")
        with self._stopped_on_failure():
            self._heed()
            self._moving, self._due = True, self.clock.now()
            self._home()
            self._await(_HOMING_SECONDS)
            self._start(Position(0.0, 0.0), self._position())  # the reference may lie beyond the limits
            self._await(_HOMING_SECONDS)
            self._reported()
        self._declare_known()

    def move_to(self, pan: float, tilt: float) -> None:
        """Start to move to absolute angles in radians; `wait` for the end.

        Raises:
            LimitError: an angle outside the limits, nothing was sent; or it reports one, and is now unknown.
            StateError: the position is unknown.
            MotionStoppedError: it was interrupted.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("move")
        self.limits.check(pan, tilt)
        with self._known("move"):
            self._heed()
            self._start(Position(pan, tilt), self._reported())

    def wait(self, timeout: float = 10.0) -> None:
        """Return when the movement has ended.

        Args:
            timeout: seconds that it may take beyond what its distance needs at the stage's speed.

        Raises:
            DeviceTimeoutError: not there in time; it was stopped.
            LimitError: the stage ran into a limit on its way; the position is unknown.
            StateError: the position is unknown.
            MotionStoppedError: it was interrupted, and stopped.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("wait for")
        with self._known("wait for"):
            if self._moving:
                self._await(timeout)

    def stop(self) -> None:
        """Halt at once, whatever it does; returns when it stands still, with no movement left to be done.

        Raises:
            OperationError: it is not certain that it stands; the position is unknown.
        """
        self._require_open("stop")
        with self._undisturbed():
            try:
                self._stop()
                self._moving = False
            except BaseException as error:
                self._declare_unknown(f"it could not be stopped for certain: {error}")
                raise

    @property
    def position(self) -> Position:
        """Where the stage reports to be: its own steps, not what was asked.

        Raises:
            StateError: the position is unknown.
            LimitError: it reports an angle beyond its limits; the position is unknown.
            DeviceLostError: the stage does not answer.
        """
        self._require_open("read the position of")
        with self._known("read the position of"):
            return self._reported()

    @property
    def resolution(self) -> float:
        """Smallest step, radians, of the coarser axis; 0 = finer than matters."""
        self._require_open("read the resolution of")
        return self._resolution()

    @property
    def limits(self) -> Limits:
        """Angles that the stage accepts: its own limits and those of the options, whichever are narrower."""
        self._require_open("read the limits of")
        own = self._limits()
        return own.within(self.options.limits) if isinstance(self.options, MotionOptions) else own

    @property
    def speed(self) -> float:
        """The fastest that any axis turns, rad/s."""
        self._require_open("read the speed of")
        return self._speed()

    def __str__(self) -> str:
        return type(self).__name__

    def _start(self, target: Position, here: Position) -> None:
        distance = max(abs(target.pan - here.pan), abs(target.tilt - here.tilt))
        seconds = duration(distance, self._speed(), self._acceleration())
        self._due = self.clock.now() + round(seconds * 1e9)
        self._moving = True
        self._move_to(target.pan, target.tilt)

    def _await(self, timeout: float) -> None:
        deadline = max(self.clock.now(), self._due) + round(timeout * 1e9)
        while (rest := self._remaining()) > 0:
            left = (deadline - self.clock.now()) * 1e-9
            if left <= 0:
                raise DeviceTimeoutError(
                    f"{self}: not at its target {timeout:g} s after it should have been there, and stopped; "
                    "check that nothing blocks it"
                )
            self._pause(min(rest, left))
        self._moving = False

    def _reported(self) -> Position:
        position = self._position()
        if not isinstance(position, Position):
            raise TypeError(f"{type(self).__name__}._position gave {position!r}; expected a Position")
        self.limits.check_reported(position, str(self))
        return position

    def _pause(self, seconds: float) -> None:
        """Let time pass; raises `MotionStoppedError` once interrupted."""
        end = self.clock.now() + round(seconds * 1e9)
        self._heed()
        while (left := end - self.clock.now()) > 0:
            self.clock.sleep(min(left * 1e-9, _SLICE))
            self._heed()

    def _heed(self) -> None:
        """Raise `MotionStoppedError` once interrupted, except while stopping and closing."""
        if not self._ending and self.interrupted():
            raise MotionStoppedError(f"{self}: told to stop")

    @contextmanager
    def _undisturbed(self) -> Iterator[None]:
        before, self._ending = self._ending, True
        try:
            yield
        finally:
            self._ending = before

    @contextmanager
    def _known(self, action: str) -> Iterator[None]:
        if self._unknown is not None:
            raise StateError(
                f"cannot {action} this {type(self).__name__}, its position is unknown ({self._unknown}): "
                "home it first"
            )
        with self._stopped_on_failure():
            yield

    @contextmanager
    def _stopped_on_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            if isinstance(error, (DeviceLostError, LimitError)):
                self._declare_unknown(str(error))
            self._stop_movement()
            raise

    def _stop_movement(self) -> None:
        """Stop what moves; a stage that cannot be stopped is unknown, and said to be so."""
        if not self._moving:
            return
        try:
            self.stop()
        except DriverError as error:
            _log.error("%s could not be stopped for certain: %s", self, error)

    def _declare_unknown(self, reason: str) -> None:
        self._unknown = reason

    def _declare_known(self) -> None:
        self._unknown = None
