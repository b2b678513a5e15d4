"""SIGINT, SIGTERM and SIGHUP from the first instant on: noted, an interruption, or a wish to stop."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_IMPATIENCE = 2.0
"""Seconds after which a second signal is meant: `timeout` and some supervisors send each one twice."""

_came: list[int] = []

Handler = Callable[[int, FrameType | None], object]


def note() -> None:
    """From now on do nothing when one comes but remember it, until somebody asks for more."""
    _handle(lambda number, _: _came.append(number))


@contextmanager
def interrupting() -> Iterator[None]:
    """Each raises KeyboardInterrupt, as Ctrl-C does, so that what was begun is cleaned up; one noted, now."""

    def interrupt(number: int, _frame: FrameType | None) -> None:
        _came.append(number)
        raise KeyboardInterrupt

    with _handled(interrupt):
        if _came:
            raise KeyboardInterrupt
        yield


class Stopping:
    """The first one is a wish to stop; another some seconds later ends the process at once."""

    def __init__(self) -> None:
        self._stop: Callable[[], object] | None = None
        self._first: float | None = time.monotonic() if _came else None

    @property
    def told(self) -> bool:
        """Whether one came."""
        return self._first is not None

    def stops(self, stop: Callable[[], object]) -> None:
        """From now on they have this called; for one that came before, now."""
        self._stop = stop
        if self.told:
            stop()

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        now = time.monotonic()
        _came.append(number)
        self._first = self._first or now
        if self._stop is not None:
            self._stop()
        if now - self._first > _IMPATIENCE:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)


@contextmanager
def stopping() -> Iterator[Stopping]:
    """Signals are a wish to stop meanwhile."""
    handler = Stopping()
    with _handled(handler):
        yield handler


@contextmanager
def _handled(handler: Handler) -> Iterator[None]:
    before = _handle(handler)
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)
        if before:
            _came.clear()


def _handle(handler: Handler) -> dict[int, "signal._HANDLER"]:
    """Set one, and return what was there; what is ignored (nohup does that) stays so."""
    if current_thread() is not main_thread():
        return {}
    wanted = [number for number in _NUMBERS if signal.getsignal(number) is not signal.SIG_IGN]
    return {number: signal.signal(number, handler) for number in wanted}
