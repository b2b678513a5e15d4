"""Hands every event to every sink."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Lock
from types import TracebackType
from typing import Self

from service.errors import SinkError
from service.messages.events import Event
from service.messages.status import SinkState
from service.sinks.patience import Patience
from service.sinks.runner import SinkRunner
from service.sinks.sink import Sink

_REMEMBERED = 1000
"""Sinks that were removed of which files and losses are remembered: a recorder comes and goes for weeks."""


class Bus:
    """The sinks of a run; they come and go while it lasts, and none can touch another or whoever emits.

    Args:
        lossless: whoever emits waits for full queues, for each at most ten seconds; then that sink is failed.
        patience: how long anything is waited for.
    """

    def __init__(self, *, lossless: bool = False, patience: Patience = Patience()) -> None:  # noqa: B008 — frozen
        self._lossless, self._patience = lossless, patience
        self._runners: dict[str, SinkRunner] = {}
        self._former: deque[tuple[list[str], list[str]]] = deque(maxlen=_REMEMBERED)
        self._lasting: dict[type[Event], Event] = {}
        self._changing = Lock()

    def add(self, name: str, make: Callable[[], Sink], *, must_open: bool = True) -> None:
        """Begin with a sink.

        Args:
            name: how it is called in status and log.
            make: makes one, closed; called again after a fault.
            must_open: raise what opening it raises, instead of trying again.

        Raises:
            SinkError: one of that name is there.
        """
        with self._changing:
            if name in self._runners:
                raise SinkError(f"there is a sink {name!r} already; give the other one another name")
            runner = SinkRunner(name, make, self.lasting, lossless=self._lossless, patience=self._patience)
            runner.start(must_open=must_open)
            self._runners = {**self._runners, name: runner}

    def remove(self, name: str, timeout: float = 10.0) -> SinkState:
        """Have a sink finish; says how it went.

        Raises:
            SinkError: there is none of that name.
        """
        with self._changing:
            if name not in self._runners:
                raise SinkError(f"there is no sink {name!r}; there are: {', '.join(self._runners) or 'none'}")
            runner = self._runners[name]
            self._runners = {key: one for key, one in self._runners.items() if key != name}
        runner.close(timeout)
        self._former.append((runner.files, runner.losses))
        return runner.state

    def emit(self, event: Event) -> None:
        """Hand an event to all sinks that want it."""
        if event.lasting:
            self._lasting = {**self._lasting, type(event): event}
        for runner in self._runners.values():
            runner.put(event)

    def lasting(self) -> Sequence[Event]:
        """The latest of each kind that lasts."""
        return tuple(self._lasting.values())

    def watch(self) -> None:
        """Look after sinks that hang; to be called now and then."""
        for runner in self._runners.values():
            runner.watch()

    def sink(self, name: str) -> Sink | None:
        """The sink of that name that is at work, or None."""
        runner = self._runners.get(name)
        return None if runner is None else runner.sink

    @property
    def states(self) -> tuple[SinkState, ...]:
        """How each is doing."""
        return tuple(runner.state for runner in self._runners.values())

    @property
    def files(self) -> list[str]:
        """What was written, complete."""
        return [file for files, _ in self._all() for file in files]

    @property
    def losses(self) -> list[str]:
        """What was lost on the way, in words; complete once it is closed."""
        return [loss for _, losses in self._all() for loss in losses]

    def close(self, timeout: float = 10.0, *, discard: bool = False, hurry: bool = False) -> None:
        """Have all finish, or leave nothing behind; gives up those that take longer than `timeout` s.

        In a `hurry` nothing that may be passed over, as pictures, is worked off any more.
        """
        end = time.monotonic() + timeout
        with self._changing:
            runners = list(self._runners.values())
        for runner in runners:
            runner.end(discard=discard, hurry=hurry)
        for runner in runners:
            runner.close(max(0.1, end - time.monotonic()), discard=discard)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(Exception):
            self.close(discard=kind is not None)

    def _all(self) -> list[tuple[list[str], list[str]]]:
        """Files and losses of each, those that are gone first."""
        return [*self._former, *((runner.files, runner.losses) for runner in self._runners.values())]
