"""Runs one sink apart from everything else: its queue, its thread, its restarts."""

import logging
import time
from collections.abc import Callable, Sequence
from threading import Thread

from drivers.errors import DriverError
from service.errors import ServiceError, SinkError
from service.messages.events import Event
from service.messages.status import SinkState
from service.sinks.account import Account
from service.sinks.attempt import Attempt, Duty
from service.sinks.patience import Patience
from service.sinks.queue import BoundedQueue
from service.sinks.sink import Sink

_TIMES_USUAL = 10.0
"""A sink hangs that works on one event for that many times as long as ever before, and as it may at least."""

_ABANDONED = 3
"""Hanging threads at most; then the sink waits until they come back."""

_log = logging.getLogger(__name__)


class SinkRunner:
    """One sink: a queue in front of it, a thread in which it works, another sink after a fault.

    Args:
        name: of the sink.
        make: makes one, closed.
        lasting: what a sink that begins is told first.
        lossless: `put` waits for a full queue.
        patience: how long anything is waited for.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], Sink],
        lasting: Callable[[], Sequence[Event]] = tuple,
        *,
        lossless: bool = False,
        patience: Patience = Patience(),  # noqa: B008 — frozen
    ) -> None:
        self.name, self._account = name, Account(name)
        self._make, self._lasting, self._lossless, self._patience = make, lasting, lossless, patience
        self._told = 0
        self._slowest = 0.0
        self._hanging: list[Thread] = []
        self._newest_suffice = self._waits = False

    def start(self, *, must_open: bool) -> None:
        """Begin; where it `must_open` it is opened here.

        Raises:
            ServiceError, DriverError, OSError: as making and opening it; anything else as `SinkError`.
        """
        try:
            sink = self._make()
            if must_open:
                sink.open()
        except (ServiceError, DriverError, OSError):
            raise
        except Exception as error:  # a class of somebody else's
            raise SinkError(f"sink {self.name!r} cannot begin: {type(error).__name__}: {error}") from error
        self._slowest, self._newest_suffice = sink.slowest, sink.newest_suffice
        account = self._account
        account.may_skip = sink.newest_suffice and not self._lossless
        account.unit, account.worth = sink.unit, sink.worth
        queue: BoundedQueue[Event] = BoundedQueue(
            sink.room.events,
            sink.room.size,
            dropped=account.drop,
            droppable=lambda event: isinstance(event, sink.droppable),
        )
        self._duty = Duty(self.name, self._make, self._lasting, sink.wants, queue, account, self._patience)
        self._attempt = Attempt(self._duty, sink if must_open else None)

    def put(self, event: Event) -> None:
        """Hand an event over; waits only in a lossless run, and never for long."""
        if not isinstance(event, self._duty.wants):
            return
        if self._account.state == "failed":
            self._account.drop(event)
        elif self._lossless and event.patient:
            if not self._duty.queue.put_patiently(event, event.size, self._patience.held):
                self._account.drop(event)
                self._give_up(f"it held the run back for {self._patience.held:g} s")
        else:
            self._duty.queue.put(event, event.size)

    def watch(self) -> None:
        """Give up a thread that hangs, and begin another; to be called now and then."""
        attempt, now = self._attempt, time.monotonic()
        limit = max(self._patience.hang, self._slowest, _TIMES_USUAL * self._duty.longest)
        if attempt.began is not None and now - attempt.began > limit and self._account.state != "failed":
            self._abandon(f"it hung for {now - attempt.began:.0f} s")
            self._begin_unless_all_hang()
        elif self._waits:
            self._begin_unless_all_hang()
        dropped = self._account.dropped(self.sink)
        if dropped > self._told and not self._account.may_skip:
            _log.warning("sink %s: %d %s lost so far", self.name, dropped, self._account.unit)
            self._told = dropped

    def _begin_unless_all_hang(self) -> None:
        """Begin another thread, where not too many hang; what hung on a disk or a share may come back."""
        self._hanging = [thread for thread in self._hanging if thread.is_alive()]
        if len(self._hanging) < _ABANDONED:
            self._waits = False
            self._attempt = Attempt(self._duty, None)
        elif not self._waits:
            self._waits, account = True, self._account
            account.state = "failed"
            account.error = f"it hung {account.abandoned} times; it goes on once what it waits for comes back"
            _log.error("sink %s: %s", self.name, account.error)
            self._duty.queue.clear()

    def end(self, *, discard: bool = False, hurry: bool = False) -> None:
        """Take nothing more, work off what waits and finish; or leave nothing behind.

        In a `hurry` what waits for a sink that may pass over events is dropped, and counted.
        """
        self._duty.discarding = discard
        if discard or (hurry and self._newest_suffice):
            self._duty.queue.clear()
        self._duty.over.set()
        self._duty.queue.close()

    def close(self, timeout: float, *, discard: bool = False) -> None:
        """End it, and give it up where that takes longer than `timeout` seconds."""
        self.end(discard=discard)
        failed = self._account.state == "failed"
        if not self._attempt.abandoned:
            self._join(min(timeout, self._patience.held) if failed else timeout)
            if self._attempt.thread.is_alive():
                self._abandon(f"it did not finish within {timeout:.0f} s")
                self._duty.queue.clear()
        self._account.state = "failed" if failed else "ended"

    def _join(self, timeout: float) -> None:
        """Wait for the thread, in a lossless run for as long as it gets on with its work."""
        while True:
            taken = self._account.taken
            self._attempt.thread.join(timeout)
            if not (self._attempt.thread.is_alive() and self._lossless and self._account.taken > taken):
                return

    @property
    def sink(self) -> Sink | None:
        """The one at work."""
        return self._attempt.sink

    @property
    def state(self) -> SinkState:
        """How it is doing."""
        return self._account.told(self.sink, len(self._duty.queue))

    @property
    def files(self) -> list[str]:
        """What its sinks have written, complete."""
        return self._account.files(self.sink)

    @property
    def losses(self) -> list[str]:
        """What was lost to it, in words; complete once it is closed."""
        return self._account.losses(self.sink)

    def _abandon(self, why: str) -> None:
        self._attempt.abandon(why)
        self._hanging = [one for one in (*self._hanging, self._attempt.thread) if one.is_alive()]

    def _give_up(self, why: str) -> None:
        self._account.state, self._account.error = "failed", why
        _log.error("sink %s is given up for good: %s", self.name, why)
        self._duty.over.set()
        self._duty.queue.close()
        self._duty.queue.clear()
