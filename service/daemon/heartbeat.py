"""Does something once a second in a thread of its own."""

import logging
from collections.abc import Callable
from threading import Event, Thread
from types import TracebackType
from typing import Self

_log = logging.getLogger(__name__)


class Heartbeat:
    """Calls `beat` at once and then every `interval` seconds, until closed; what it raises is logged."""

    def __init__(self, beat: Callable[[], None], interval: float = 1.0) -> None:
        self._beat, self._interval = beat, interval
        self._over = Event()
        self._thread = Thread(target=self._run, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        while True:
            try:
                self._beat()
            except Exception:  # one bad beat must not be the last
                _log.exception("heartbeat")
            if self._over.wait(self._interval):
                return
