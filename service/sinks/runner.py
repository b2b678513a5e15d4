"""Runs one sink apart from everything else: its queue, its thread, its restarts."""

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Event as Flag
from threading import Thread

from drivers.errors import DriverError
from service.errors import EncodingError, ServiceError, SinkError
from service.leaving import leave_behind
from service.messages.events import Event, Logged
from service.messages.status import SinkState
from service.sinks.account import Account
from service.sinks.attempt import Attempt
from service.sinks.patience import Patience
from service.sinks.queue import BoundedQueue
from service.sinks.sink import Sink

_TIMES_USUAL = 10.0
"""A sink hangs that works on one event for that many times as long as ever before, and as it may at least."""

_ABANDONED = 3
"""Hanging threads at most; then the sink waits until they come back."""

_LONGEST_WAIT = 30.0
"""Seconds from one restart to the next, at most."""

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
        self._wants: tuple[type[Event], ...] = (Event,)
        self._told = 0
        self._longest = self._slowest = 0.0
        self._hanging: list[Thread] = []
        self._discarding = self._newest_suffice = self._waits = False
        self._over = Flag()

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
        self._wants, self._slowest = sink.wants, sink.slowest
        self._newest_suffice = sink.newest_suffice
        account = self._account
        account.may_skip = sink.newest_suffice and not self._lossless
        account.unit, account.worth = sink.unit, sink.worth
        self._queue: BoundedQueue[Event] = BoundedQueue(
            sink.room.events,
            sink.room.size,
            dropped=account.drop,
            droppable=lambda event: isinstance(event, sink.droppable),
        )
        self._begin(sink if must_open else None)

    def put(self, event: Event) -> None:
        """Hand an event over; waits only in a lossless run, and never for long."""
        if not isinstance(event, self._wants):
            return
        if self._account.state == "failed":
            self._account.drop(event)
        elif self._lossless and event.patient:
            if not self._queue.put_patiently(event, event.size, self._patience.held):
                self._account.drop(event)
                self._give_up(f"it held the run back for {self._patience.held:g} s")
        else:
            self._queue.put(event, event.size)

    def watch(self) -> None:
        """Give up a thread that hangs, and begin another; to be called now and then."""
        attempt, now = self._attempt, time.monotonic()
        limit = max(self._patience.hang, self._slowest, _TIMES_USUAL * self._longest)
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
        leave_behind(self._thread)
        self._hanging = [thread for thread in self._hanging if thread.is_alive()]
        if len(self._hanging) < _ABANDONED:
            self._waits = False
            self._begin(None)
        elif not self._waits:
            self._waits, account = True, self._account
            account.state = "failed"
            account.error = f"it hung {account.abandoned} times; it goes on once what it waits for comes back"
            _log.error("sink %s: %s", self.name, account.error)
            self._queue.clear()

    def end(self, *, discard: bool = False, hurry: bool = False) -> None:
        """Take nothing more, work off what waits and finish; or leave nothing behind.

        In a `hurry` what waits for a sink that may pass over events is dropped, and counted.
        """
        self._discarding = discard
        if discard or (hurry and self._newest_suffice):
            self._queue.clear()
        self._over.set()
        self._queue.close()

    def close(self, timeout: float, *, discard: bool = False) -> None:
        """End it, and give it up where that takes longer than `timeout` seconds."""
        self.end(discard=discard)
        failed = self._account.state == "failed"
        if not self._attempt.abandoned:
            self._join(min(timeout, self._patience.held) if failed else timeout)
            if self._thread.is_alive():
                self._abandon(f"it did not finish within {timeout:.0f} s")
                self._queue.clear()
        self._account.state = "failed" if failed else "ended"

    def _join(self, timeout: float) -> None:
        """Wait for the thread, in a lossless run for as long as it gets on with its work."""
        while True:
            taken = self._account.taken
            self._thread.join(timeout)
            if not (self._thread.is_alive() and self._lossless and self._account.taken > taken):
                return

    @property
    def sink(self) -> Sink | None:
        """The one at work."""
        return self._attempt.sink

    @property
    def state(self) -> SinkState:
        """How it is doing."""
        return self._account.told(self.sink, len(self._queue))

    @property
    def files(self) -> list[str]:
        """What its sinks have written, complete."""
        return self._account.files(self.sink)

    @property
    def losses(self) -> list[str]:
        """What was lost to it, in words; complete once it is closed."""
        return self._account.losses(self.sink)

    def _begin(self, sink: Sink | None) -> None:
        self._attempt = Attempt(sink)
        self._thread = Thread(target=self._run, args=(self._attempt,), name=self.name, daemon=True)
        self._thread.start()

    def _run(self, attempt: Attempt) -> None:
        wait = self._patience.restart
        while not attempt.abandoned:
            taken = self._account.taken
            try:
                self._serve(attempt)
                return
            except Exception as error:  # whatever a sink raises stays here
                if attempt.abandoned:
                    return
                self._retire(attempt)
                wait = self._patience.restart if self._account.taken > taken else wait
                self._fault(error, wait)
            if self._over.wait(wait):
                self._queue.clear()
                return
            wait = min(2 * wait, _LONGEST_WAIT)

    def _serve(self, attempt: Attempt) -> None:
        """Open a sink where there is none, give it the events until the queue ends, close it."""
        with attempt.at_work():
            if attempt.sink is None:
                attempt.sink = self._make()
                attempt.sink.open()
            sink, known = attempt.sink, self._lasting()
            for event in known:
                if isinstance(event, self._wants):
                    sink.take(event)
        if attempt.abandoned:
            return
        self._account.state = "running"
        while not attempt.abandoned and (waiting := self._queue.get()) is not None:
            if not any(waiting is one for one in known):
                self._take(attempt, sink, waiting)
        if not attempt.abandoned:
            sink.discard() if self._discarding else sink.close()

    def _take(self, attempt: Attempt, sink: Sink, event: Event) -> None:
        began = time.monotonic()
        try:
            with attempt.at_work():
                sink.take(event)
        except EncodingError as error:
            # Not the sink's fault: it goes on with the next event.
            self._lose(attempt, error, event)
            return
        except Exception:
            if not attempt.abandoned:
                self._account.drop(event)
            raise
        if not attempt.abandoned:
            self._account.taken += 1
            self._longest = max(self._longest, time.monotonic() - began)

    def _lose(self, attempt: Attempt, error: Exception, event: Event) -> None:
        if attempt.abandoned:
            return
        self._account.fault(str(error), state="running")
        self._account.drop(event)
        if not isinstance(event, Logged):  # or it would come back
            _log.error("sink %s: %s", self.name, error)

    def _fault(self, error: Exception, wait: float) -> None:
        why = str(error) or type(error).__name__
        self._account.fault(why, state="restarting")
        _log.error("sink %s failed: %s; starting it again in %.1f s", self.name, why, wait)

    def _retire(self, attempt: Attempt) -> None:
        """Close a sink that failed; what it has written so far is kept."""
        sink, attempt.sink = attempt.sink, None
        if sink is None:
            return
        with suppress(Exception), attempt.at_work():
            sink.discard() if self._discarding else sink.close()
        self._account.keep(sink)

    def _abandon(self, why: str) -> None:
        attempt = self._attempt
        attempt.abandoned, attempt.began = True, None
        sink, attempt.sink = attempt.sink, None
        if sink is not None:
            sink.abandoned.set()
            with suppress(Exception):
                sink.abandon()
            self._account.keep(sink)
        self._hanging = [thread for thread in (*self._hanging, self._thread) if thread.is_alive()]
        self._account.abandon(why)
        _log.error("sink %s was given up: %s", self.name, why)

    def _give_up(self, why: str) -> None:
        self._account.state, self._account.error = "failed", why
        _log.error("sink %s is given up for good: %s", self.name, why)
        self._over.set()
        self._queue.close()
        self._queue.clear()
