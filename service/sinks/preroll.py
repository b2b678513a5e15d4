"""What is in no file yet: the last seconds before a recording begins, or before it goes on."""

from collections import deque
from collections.abc import Callable, Iterable

from service.sinks.recording_file import Unit


class Preroll:
    """Units in the order in which they came, bounded by age and by bytes.

    Args:
        seconds: how long one is kept.
        size: most bytes.
    """

    def __init__(self, seconds: float, size: int) -> None:
        self._seconds, self._size = seconds, size
        self._units: deque[Unit] = deque()
        self._bytes = 0

    @property
    def first(self) -> Unit | None:
        """The oldest."""
        return self._units[0] if self._units else None

    def append(self, unit: Unit) -> None:
        """Take the newest."""
        self._units.append(unit)
        self._bytes += unit.size

    def put_back(self, units: Iterable[Unit]) -> None:
        """Have units before all others again."""
        for unit in reversed(list(units)):
            self._units.appendleft(unit)
            self._bytes += unit.size

    def pop(self) -> Unit:
        """Hand the oldest out."""
        unit = self._units.popleft()
        self._bytes -= unit.size
        return unit

    def keep(self, wanted: Callable[[Unit], bool]) -> None:
        """Drop all but what is wanted."""
        self._units = deque(unit for unit in self._units if wanted(unit))
        self._bytes = sum(unit.size for unit in self._units)

    def forget(self, now: float) -> int:
        """Drop what is too old or too much at `now` (as `Unit.taken`); says how many messages went."""
        gone = 0
        while self._units and (now - self._units[0].taken >= self._seconds or self._bytes > self._size):
            gone += len(self.pop().messages)
        return gone

    def clear(self) -> int:
        """Drop all; says how many messages went."""
        gone = sum(len(unit.messages) for unit in self._units)
        self._units.clear()
        self._bytes = 0
        return gone
