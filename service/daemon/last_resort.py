"""Ends a service whose devices do not let go: a library that hangs must not keep it from ending."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event as Flag
from threading import Thread

_LOOK = 0.5


class Wish(Flag):
    """The wish to stop, and since when there is one."""

    def __init__(self) -> None:
        super().__init__()
        self._since: float | None = None

    def set(self) -> None:
        self._since = self._since or time.monotonic()
        super().set()

    @property
    def seconds(self) -> float:
        """For how long; 0 while there is none."""
        return 0.0 if self._since is None else time.monotonic() - self._since


@contextmanager
def last_resort(stop: Flag, patience: Callable[[], float], hand_over: Callable[[], None]) -> Iterator[None]:
    """Have `hand_over` called, in another thread, where the context is not left soon after `stop` was set.

    Args:
        stop: the wish to stop.
        patience: seconds in which the owner of the devices has to come back.
        hand_over: ends all without it.
    """
    left = Flag()

    def watch() -> None:
        while not left.is_set():
            if stop.wait(_LOOK):
                if not left.wait(patience()):
                    hand_over()
                return

    Thread(target=watch, name="last resort", daemon=True).start()
    try:
        yield
    finally:
        left.set()
