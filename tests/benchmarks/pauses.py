"""How long the machine itself pauses: what no program can make up for."""

import time
from threading import Event, Thread
from types import TracebackType
from typing import Self

from service.capture.priority import Foremost

_SLEEP = 2e-3


class Pauses:
    """A context in which a thread of the highest priority there is sleeps for 2 ms, again and again.

    Args:
        least: seconds by which it has to wake up late for it to count.

    Attributes:
        late: the seconds by which it did, each time.
    """

    def __init__(self, least: float) -> None:
        self._least = least
        self.late: list[float] = []
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
                late = time.monotonic() - began - _SLEEP
                if late >= self._least:
                    self.late.append(late)
