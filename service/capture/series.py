"""Takes burst after burst, or frame after frame, whatever happens to the devices meanwhile."""

import logging
import time
from collections.abc import Callable, Iterator
from typing import Generic, Protocol, TypeVar

from drivers.errors import EndOfRecordingError, MotionStoppedError, OperationError
from service.capture.control import StoppedError
from service.capture.grabber import Grabber

_SLICE = 0.05
"""Seconds after which a pause between two bursts looks for something to do, and whether it is over."""

_INSTANT = 1e-9
"""Seconds: less cannot be slept."""

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

_log = logging.getLogger(__name__)


class Source(Protocol[T_co]):
    """A way to take bursts, or the frames of a stream."""

    def take(self, number: int) -> T_co:
        """The burst, or the stream's frame, of that number; raises as the devices do."""


class Recover(Protocol):
    """Opens lost devices again."""

    def __call__(self, error: OperationError) -> bool:
        """Tell why, and try until it is done; False where something else was asked for first."""


Pause = Callable[[float], float]
"""Seconds left of a pause, so many seconds after it began."""


def _no_pause(elapsed: float) -> float:  # noqa: ARG001
    return 0.0


class Capture(Generic[T]):
    """Takes burst after burst, or frame after frame, and survives what happens to the devices.

    Args:
        grabber: gives frames of the (open) rig.
        source: takes them.
        recover: opens lost devices again; None = without telling anybody.
        ending: whether something else was asked for: looked at between two bursts.
        pause: between one and the next; asked again and again while it lasts.
        hurried: whether the next one shall not wait for that.
        first: number of the first.

    Attributes:
        number: of the burst, or frame, at work, or of the next one.
        began: when the burst, or frame, at work was begun, `time.monotonic()`.
    """

    def __init__(
        self,
        grabber: Grabber,
        source: Source[T],
        recover: Recover | None = None,
        ending: Callable[[], bool] = lambda: False,
        *,
        pause: Pause = _no_pause,
        hurried: Callable[[], bool] = lambda: False,
        first: int = 0,
    ) -> None:
        self.counts, self.number = grabber.counts, first
        self._grabber, self._control, self._rig = grabber, grabber.control, grabber.rig
        self._source, self._recover = source, recover if recover is not None else self._reopen
        self._ending, self._hurried, self._pause = ending, hurried, pause
        self.began = 0.0

    def run(self) -> Iterator[T]:
        """All until told otherwise or a recording ends; what is interrupted is taken again.

        Raises:
            MotionError: the stage must not move any more.
        """
        pause: Pause = _no_pause
        while not self._control.halted:
            try:
                self._rest(pause)
                if self._control.halted or self._ending():
                    return
                self.began = time.monotonic()
                taken = self._source.take(self.number)
            except EndOfRecordingError:
                return
            except (StoppedError, MotionStoppedError):
                self.number += 1  # frames of this one have gone out
                return
            except OperationError as error:
                self._note(error)
                if not self._recover(error):
                    self.number += 1
                    return
                self._grabber.restart()
                continue
            self.number += 1
            yield taken
            pause = self._pause

    def _rest(self, pause: Pause) -> None:
        """Do what waits to be done between two bursts, until the pause is over or there is a hurry."""
        clock = self._rig.clock
        began = clock.now()
        self._control.between_bursts()
        while (left := pause((clock.now() - began) / 1e9)) >= _INSTANT and not (
            self._control.halted or self._ending() or self._hurried()
        ):
            self._control.beat()
            clock.sleep(min(_SLICE, left))
            self._control.between_bursts()
            self._grabber.restart()  # frames that pass meanwhile are not missed

    def _note(self, error: OperationError) -> None:
        self.counts.lost += 1
        self.counts.interrupted += 1
        self.counts.error = str(error)
        _log.error("number %d interrupted: %s; opening the devices again", self.number, error)

    def _reopen(self, error: OperationError) -> bool:  # noqa: ARG002
        return self._rig.reopen(lambda: self._control.halted)
