"""The queue before a sink: bounded by count and by bytes."""

from collections import deque
from collections.abc import Callable
from threading import Condition
from typing import Generic, TypeVar

T = TypeVar("T")


class BoundedQueue(Generic[T]):
    """Items on their way to one consumer thread.

    It holds at most `items` items and `size` bytes, but always takes one.

    Args:
        items: most items.
        size: most bytes.
        dropped: called with each item that goes because there is no room, or that comes after `close`.
        droppable: which items go first, oldest first; where none of them is left, the oldest of all goes.
    """

    def __init__(
        self,
        items: int,
        size: int,
        *,
        dropped: Callable[[T], None] = lambda _: None,
        droppable: Callable[[T], bool] = lambda _: True,
    ) -> None:
        self._items, self._size = items, size
        self._dropped, self._droppable = dropped, droppable
        self._queue: deque[tuple[T, int]] = deque()
        self._bytes = 0
        self._closed = False
        self._changed = Condition()

    def put(self, item: T, size: int) -> None:
        """Hand over an item of `size` bytes, in place of older ones where there is no room."""
        with self._changed:
            lost = [item] if self._closed else self._make_room(size)
            if not self._closed:
                self._append(item, size)
        for gone in lost:
            self._dropped(gone)

    def put_patiently(self, item: T, size: int, timeout: float) -> bool:
        """Hand over an item once there is room; False, and not taken, where there is none in `timeout` s."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._closed or self._fits(size), timeout):
                return False
            if not self._closed:
                self._append(item, size)
                return True
        self._dropped(item)
        return True

    def get(self) -> T | None:
        """The next item, waiting for one; None once it is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or bool(self._queue))
            if not self._queue:
                return None
            item, size = self._queue.popleft()
            self._bytes -= size
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Take nothing more; what is in it can still be got."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def clear(self) -> None:
        """Drop what is in it."""
        with self._changed:
            gone = [item for item, _ in self._queue]
            self._queue.clear()
            self._bytes = 0
            self._changed.notify_all()
        for item in gone:
            self._dropped(item)

    def __len__(self) -> int:
        return len(self._queue)

    def _append(self, item: T, size: int) -> None:
        self._queue.append((item, size))
        self._bytes += size
        self._changed.notify_all()

    def _fits(self, size: int) -> bool:
        full = len(self._queue) >= self._items or self._bytes + size > self._size
        return not full or not self._queue

    def _make_room(self, size: int) -> list[T]:
        lost = []
        while not self._fits(size):
            place = next((k for k, (item, _) in enumerate(self._queue) if self._droppable(item)), 0)
            item, freed = self._queue[place]
            del self._queue[place]
            self._bytes -= freed
            lost.append(item)
        return lost
