"""Items made ahead, in a thread of their own."""

from collections.abc import Iterator
from contextlib import suppress
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import TypeVar

T = TypeVar("T")

_LOOK = 0.1
"""Seconds after which a thread that waits for room looks whether anybody still wants its items."""


def prefetched(items: Iterator[T], ahead: int) -> Iterator[T]:
    """The same items, up to `ahead` of which are made while the one before is being used.

    What making them raises is raised here, in its place. Closing the generator ends the thread.
    """
    room: Queue[tuple[T | None, BaseException | None]] = Queue(maxsize=ahead)
    unwanted = Event()

    def put(item: T | None, error: BaseException | None) -> None:
        while not unwanted.is_set():
            with suppress(Full):
                room.put((item, error), timeout=_LOOK)
                return

    def make() -> None:
        try:
            for item in items:
                put(item, None)
                if unwanted.is_set():
                    return
            put(None, StopIteration())
        except BaseException as error:
            put(None, error)

    thread = Thread(target=make, name="prefetch", daemon=True)
    thread.start()
    try:
        while True:
            item, error = room.get()
            if isinstance(error, StopIteration):
                return
            if error is not None:
                raise error
            yield item  # type: ignore[misc]
    finally:
        unwanted.set()
        with suppress(Empty):
            room.get_nowait()
        thread.join()
