"""Ends a service whose devices do not let go: a library that hangs must not keep it from ending."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event as Flag
from threading import Thread

_PATIENCE = 3.0
"""Seconds after the wish to stop in which the owner of the devices has to come back."""

_LOOK = 0.5


@contextmanager
def last_resort(stop: Flag, hand_over: Callable[[], None]) -> Iterator[None]:
    """Have `hand_over` called, in another thread, where the context is not left 3 s after `stop` was set."""
    left = Flag()

    def watch() -> None:
        while not left.is_set():
            if stop.wait(_LOOK):
                if not left.wait(_PATIENCE):
                    hand_over()
                return

    Thread(target=watch, name="last resort", daemon=True).start()
    try:
        yield
    finally:
        left.set()
