"""SIGINT, SIGTERM and SIGHUP from the first instant on: noted, an interruption, or a wish to stop."""

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread, Timer, current_thread, main_thread
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_IMPATIENCE = 2.0
"""Seconds after which a second signal is meant: `timeout` and some supervisors send each one twice."""

_LONGEST = 4.8
"""Seconds after which whoever promised to stop is ended: five are promised."""

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
    """The first one is a wish to stop; another some seconds later ends the process at once.

    Args:
        reloads: whether SIGHUP is a wish to read the configuration again.
        give_up: ends the process; called where it is still there some seconds after the wish to stop.
    """

    def __init__(self, reloads: bool = False, give_up: Callable[[], object] | None = None) -> None:
        self._reloads = reloads
        self._last_resort = None if give_up is None else Timer(_LONGEST, give_up)
        self._stop: Callable[[], object] | None = None
        self._reload: Callable[[], object] | None = None
        self._first: float | None = None
        self._reload_waits = False

    @property
    def told(self) -> bool:
        """Whether one came that is a wish to stop."""
        return self._first is not None

    def stops(self, stop: Callable[[], object]) -> None:
        """From now on they have this called; for one that came before, now."""
        self._stop = stop
        if self.told:
            stop()

    def reloads(self, reload: Callable[[], object]) -> None:
        """From now on SIGHUP has this called, where it is none to stop; for one that came before, now."""
        self._reload = reload
        if self._reload_waits:
            reload()

    def take(self, number: int) -> None:
        """One came; called in a thread of its own."""
        if self._reloads and number == signal.SIGHUP:
            self._reload_waits = True
            if self._reload is not None:
                self._reload()
            return
        now = time.monotonic()
        if self._first is None:
            self._first = now
            if self._last_resort is not None:
                self._last_resort.daemon = True
                self._last_resort.start()
        if self._stop is not None:
            self._stop()
        if now - self._first > _IMPATIENCE:
            os._exit(128 + number)

    def close(self) -> None:
        """It has ended in time."""
        if self._last_resort is not None:
            self._last_resort.cancel()


@contextmanager
def stopping(*, reloads: bool = False, give_up: Callable[[], object] | None = None) -> Iterator[Stopping]:
    """Signals are a wish to stop meanwhile.

    A thread takes them: the main one may be in a call that lasts, of a device's library or a compiler.

    Args:
        reloads: SIGHUP is a wish to read the configuration again.
        give_up: ends the process; called, in another thread, where that is not over 4.8 s after the wish.
    """
    taker = Stopping(reloads, give_up)
    if current_thread() is not main_thread():
        yield taker
        return
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    with ours, _handled(lambda *_: None):
        former = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
        thread = Thread(target=_listen, args=(ours, taker), name="signals", daemon=True)
        thread.start()
        try:
            for number in _came:
                taker.take(number)
            yield taker
        finally:
            signal.set_wakeup_fd(former)
            theirs.close()
            thread.join()
            taker.close()


def _listen(connection: socket.socket, taker: Stopping) -> None:
    while numbers := connection.recv(64):
        for number in numbers:
            if number in _NUMBERS:
                taker.take(number)


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
