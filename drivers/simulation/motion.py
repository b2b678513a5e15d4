"""How one axis of a stage moves: constant speed, and an error that comes with each arrival."""

from collections import deque
from dataclasses import dataclass

REMEMBERED = 256
"""Movements kept, so that a frame may ask where the stage was while it was exposed."""


@dataclass(frozen=True, slots=True)
class _Move:
    start: int
    end: int
    origin: float
    target: float
    error_before: float
    error_after: float

    def share(self, timestamp: int) -> float:
        if timestamp >= self.end:
            return 1.0
        return max(0.0, (timestamp - self.start) / (self.end - self.start))

    def commanded(self, timestamp: int) -> float:
        return self.origin + self.share(timestamp) * (self.target - self.origin)

    def error(self, timestamp: int) -> float:
        return self.error_before + self.share(timestamp) * (self.error_after - self.error_before)


class Axis:
    """One axis, at zero without error to begin with; angles in radians, times in ns."""

    def __init__(self) -> None:
        self._moves: deque[_Move] = deque([_Move(0, 0, 0.0, 0.0, 0.0, 0.0)], maxlen=REMEMBERED)

    @property
    def arrival(self) -> int:
        """When the latest movement ends, or has ended."""
        return self._moves[-1].end

    def commanded(self, timestamp: int) -> float:
        """Where the axis believes to be."""
        return self._at(timestamp).commanded(timestamp)

    def true(self, timestamp: int) -> float:
        """Where it really is."""
        move = self._at(timestamp)
        return move.commanded(timestamp) + move.error(timestamp)

    def go(self, now: int, target: float, speed: float, error: float) -> None:
        """Move from where it is to `target` at `speed` (rad/s), to arrive with `error`."""
        current = self._at(now)
        origin = current.commanded(now)
        end = now + round(abs(target - origin) / speed * 1e9)
        self._moves.append(_Move(now, end, origin, target, current.error(now), error))

    def stop(self, now: int) -> None:
        """Stand still where it is."""
        if now < self.arrival:
            move = self._at(now)
            here, error = move.commanded(now), move.error(now)
            self._moves.append(_Move(now, now, here, here, error, error))

    def _at(self, timestamp: int) -> _Move:
        for move in reversed(self._moves):
            if move.start <= timestamp:
                return move
        return self._moves[0]
