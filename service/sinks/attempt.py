"""One thread of a sink, and since when it is in the hands of that sink."""

import time

from service.sinks.sink import Sink


class Attempt:
    """One thread with one sink after the other, until it hangs."""

    def __init__(self) -> None:
        self.sink: Sink | None = None
        self.began: float | None = None
        self.abandoned = False


class timed:  # noqa: N801 — a context manager, read as a phrase
    """Notes since when the thread is in the hands of its sink."""

    def __init__(self, attempt: Attempt) -> None:
        self._attempt = attempt

    def __enter__(self) -> None:
        self._attempt.began = time.monotonic()

    def __exit__(self, *_: object) -> None:
        self._attempt.began = None
