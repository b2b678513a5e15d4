"""A short queue that refuses instead of waiting."""

from collections import deque
from threading import Condition
from typing import Generic, TypeVar

T = TypeVar("T")


class Pending(Generic[T]):
    """Items on their way to one thread; what has no room is not taken.

    Args:
        room: most items.
    """

    def __init__(self, room: int) -> None:
        self._room = room
        self._items: deque[T] = deque()
        self._closed = False
        self._changed = Condition()

    def put(self, item: T) -> bool:
        """Whether it was taken."""
        with self._changed:
            if self._closed or len(self._items) >= self._room:
                return False
            self._items.append(item)
            self._changed.notify_all()
            return True

    def get(self) -> T | None:
        """The next one, waiting for it; None once it is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or bool(self._items))
            return self._items.popleft() if self._items and not self._closed else None

    def close(self) -> list[T]:
        """Take nothing more; returns what was not got."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            return list(self._items)
