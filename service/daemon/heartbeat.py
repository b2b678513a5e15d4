"""Does something again and again in a thread of its own."""

import logging
from collections.abc import Callable
from threading import Event, Thread
from types import TracebackType
from typing import Self

from service.leaving import leave_behind

_SHORTEST = 0.1
"""Seconds from one beat to the next, however often it is asked for one."""

_log = logging.getLogger(__name__)


class Heartbeat:
    """Calls `beat` at once and then every `interval` seconds, until closed; what it raises is logged.

    Args:
        beat: what is done.
        interval: seconds.
        name: of the thread.
        patience: seconds that a beat at work gets in the end; one that takes longer is left behind.
    """

    def __init__(
        self,
        beat: Callable[[], None],
        interval: float = 1.0,
        *,
        name: str = "heartbeat",
        patience: float = 1.0,
    ) -> None:
        self._beat, self._interval, self._patience = beat, interval, patience
        self._over, self._due = Event(), Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def nudge(self) -> None:
        """Have the next beat come now; never waits."""
        self._due.set()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._due.set()
        self._thread.join(self._patience)
        if self._thread.is_alive():
            leave_behind(self._thread)

    def _run(self) -> None:
        while True:
            self._due.clear()
            try:
                self._beat()
            except Exception:  # one bad beat must not be the last
                _log.exception("%s", self._thread.name)
            if self._over.wait(min(_SHORTEST, self._interval)):
                return
            self._due.wait(self._interval - _SHORTEST)
            if self._over.is_set():
                return
