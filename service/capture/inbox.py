"""Errands for the thread that owns the devices: handed over by others, done by it when it comes to them."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from threading import Condition
from typing import Any, Literal

from drivers.errors import DeviceLostError
from service.errors import UnavailableError

Moment = Literal["pose", "burst"]
"""When an errand may be done: between two poses (also in a pause, and while a device is waited for), or
between two bursts."""

ROOM = 64
"""Errands that may wait."""


@dataclass(frozen=True, slots=True)
class _Errand:
    do: Callable[[], Any]
    moment: Moment
    result: "Future[Any]" = field(default_factory=Future)


class Inbox:
    """Errands in the order in which they came."""

    def __init__(self) -> None:
        self._errands: deque[_Errand] = deque()
        self._changed = Condition()
        self._closed: str | None = None
        self._news = False

    def submit(self, do: Callable[[], Any], moment: Moment) -> "Future[Any]":
        """Hand an errand over; its future gets what it returns or raises.

        Raises:
            UnavailableError: too many wait, or nobody will do any.
        """
        errand = _Errand(do, moment)
        with self._changed:
            if self._closed is not None:
                raise UnavailableError(self._closed)
            if len(self._errands) >= ROOM:
                raise UnavailableError(f"{ROOM} commands wait for the devices already: try again later")
            self._errands.append(errand)
        self.wake()
        return errand.result

    def serve(self, moment: Moment) -> None:
        """Do what waits for this moment; raises `DeviceLostError` where a device was lost over it."""
        while (errand := self._next(moment)) is not None:
            if not errand.result.set_running_or_notify_cancel():
                continue
            try:
                done = errand.do()
            except BaseException as error:
                errand.result.set_exception(error)
                if isinstance(error, DeviceLostError) or not isinstance(error, Exception):
                    raise
            else:
                errand.result.set_result(done)

    def wait(self, seconds: float) -> None:
        """Until something comes, or `wake` is called, since the last wait; not for longer than `seconds`."""
        with self._changed:
            self._changed.wait_for(lambda: self._news, seconds)
            self._news = False

    def wake(self) -> None:
        """End a `wait`."""
        with self._changed:
            self._news = True
            self._changed.notify_all()

    def refuse(self, error: Exception, moment: Moment = "burst") -> None:
        """Let all that wait for a moment fail."""
        while (errand := self._next(moment, only=True)) is not None:
            if errand.result.set_running_or_notify_cancel():
                errand.result.set_exception(error)

    def close(self, why: str) -> None:
        """Take nothing more, and let what waits fail."""
        with self._changed:
            self._closed = why
        self.refuse(UnavailableError(why), "pose")
        self.refuse(UnavailableError(why), "burst")

    def _next(self, moment: Moment, *, only: bool = False) -> _Errand | None:
        with self._changed:
            for errand in self._errands:
                if errand.moment == moment or (moment == "burst" and not only):
                    self._errands.remove(errand)
                    return errand
            return None
