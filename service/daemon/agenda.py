"""What comes next: the mode that was asked for last, and whose turn the next bursts are."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

from service.errors import InvalidStateError, UnavailableError

if TYPE_CHECKING:
    from service.daemon.modes import Mode
    from service.messages.map import FusedMap

TURNS = 16
"""Single bursts that may be waited for."""

Done = Callable[["FusedMap | Exception"], None]
"""Told the map of a burst, once it was handed to the sinks, or why there is none."""


@dataclass(frozen=True, slots=True)
class _Next:
    mode: Mode
    entered: Future[None]


class Agenda:
    """The next mode, and those who wait for a burst of their own; may be used from several threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._next: _Next | None = None
        self._turns: deque[Done] = deque()

    def ask(self, mode: Mode) -> Future[None]:
        """Have another mode begin after the burst, or the frame, at work; done when it has begun."""
        entered: Future[None] = Future()
        with self._lock:
            before, self._next = self._next, _Next(mode, entered)
        if before is not None:
            before.entered.set_exception(InvalidStateError("something else was asked for meanwhile"))
        return entered

    def replace(self, mode: Mode) -> None:
        """Have this one begin in place of the next, for whoever asked for that."""
        with self._lock:
            if self._next is not None:
                self._next = _Next(mode, self._next.entered)

    @property
    def next(self) -> Mode | None:
        """The mode that shall begin, if another shall."""
        following = self._next
        return None if following is None else following.mode

    def take(self) -> tuple[Mode, Future[None]] | None:
        """The next mode, and what to tell once it has begun."""
        with self._lock:
            found, self._next = self._next, None
        return None if found is None else (found.mode, found.entered)

    def queue(self, done: Done) -> None:
        """Wait for a burst of one's own; raises `UnavailableError` where too many do."""
        with self._lock:
            if len(self._turns) >= TURNS:
                raise UnavailableError(f"{TURNS} bursts are waited for already: try again later")
            self._turns.append(done)

    @property
    def awaited(self) -> bool:
        """Whether somebody waits for a burst."""
        return bool(self._turns)

    def turn(self) -> Done | None:
        """Whose burst it is that was captured just now."""
        with self._lock:
            return self._turns.popleft() if self._turns else None

    def give_up(self, why: Exception) -> None:
        """Tell all who wait for a burst that none comes."""
        with self._lock:
            turns, self._turns = list(self._turns), deque()
        for done in turns:
            done(why)

    def close(self, why: str) -> None:
        """Nothing comes any more: tell all."""
        self.give_up(UnavailableError(why))
        with self._lock:
            found, self._next = self._next, None
        if found is not None:
            found.entered.set_exception(UnavailableError(why))
