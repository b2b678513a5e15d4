"""How long the machine itself pauses: what no program can make up for."""

import time
from threading import Event, Thread
from types import TracebackType
from typing import Self

from service.capture.priority import Foremost

_SLEEP = 2e-3


class Pauses:
    """A context in which a thread of the highest priority there is sleeps for 2 ms, again and again.

    Attributes:
        longest: seconds by which it woke up late at most.
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._over = Event()
        self._thread = Thread(target=self._run, name="pauses", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        with Foremost():
            while not self._over.is_set():
                began = time.monotonic()
                time.sleep(_SLEEP)
                self.longest = max(self.longest, time.monotonic() - began - _SLEEP)
