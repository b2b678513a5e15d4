"""One thread of a sink, from its beginning until it ends or is given up."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from service.sinks.sink import Sink


@dataclass(eq=False, slots=True)
class Attempt:
    """One thread with one sink after the other, until it hangs.

    Attributes:
        sink: the one at work.
        began: since when the thread is in the hands of its sink, `time.monotonic()`; None = it is not.
        abandoned: given up; what the thread does from then on has no effect.
    """

    sink: Sink | None = None
    began: float | None = None
    abandoned: bool = False

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Note since when the thread is in the hands of its sink."""
        self.began = time.monotonic()
        try:
            yield
        finally:
            self.began = None
