"""One thread of a sink, from its beginning until it ends or is given up."""

import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from threading import Event as Flag
from threading import Thread

from service.errors import EncodingError
from service.leaving import leave_behind
from service.messages.events import Event, Logged
from service.sinks.account import Account
from service.sinks.patience import Patience
from service.sinks.queue import BoundedQueue
from service.sinks.sink import Sink

_LONGEST_WAIT = 30.0
"""Seconds from one restart to the next, at most."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class Duty:
    """What is done for a sink's name, by one thread after the other.

    Attributes:
        name: of the sink.
        make: makes one, closed.
        lasting: what a sink that begins is told first.
        wants: kinds of events that it is given.
        queue: the others.
        account: what became of them.
        patience: how long anything is waited for.
        over: there will be no more events.
        discarding: nothing shall be left of what was begun.
        longest: seconds that an event took at most.
    """

    name: str
    make: Callable[[], Sink]
    lasting: Callable[[], Sequence[Event]]
    wants: tuple[type[Event], ...]
    queue: BoundedQueue[Event]
    account: Account
    patience: Patience
    over: Flag = field(default_factory=Flag)
    discarding: bool = False
    longest: float = 0.0


class Attempt:
    """One thread with one sink after the other, until it hangs.

    Args:
        duty: what is to be done.
        sink: open; None = one is made.

    Attributes:
        sink: the one at work.
        began: since when the thread is in the hands of its sink, `time.monotonic()`; None = it is not.
        abandoned: given up; what the thread does from then on has no effect.
    """

    def __init__(self, duty: Duty, sink: Sink | None) -> None:
        self._duty, self.sink = duty, sink
        self.began: float | None = None
        self.abandoned = False
        self.thread = Thread(target=self._run, name=duty.name, daemon=True)
        self.thread.start()

    def abandon(self, why: str) -> None:
        """Give it up; for any other thread."""
        self.abandoned, self.began = True, None
        sink, self.sink = self.sink, None
        if sink is not None:
            sink.abandoned.set()
            with suppress(Exception):
                sink.abandon()
            self._duty.account.keep(sink)
        leave_behind(self.thread)
        self._duty.account.abandon(why)
        _log.error("sink %s was given up: %s", self._duty.name, why)

    def _run(self) -> None:
        wait = self._duty.patience.restart
        while not self.abandoned:
            taken = self._duty.account.taken
            try:
                self._serve()
                return
            except Exception as error:  # whatever a sink raises stays here
                if self.abandoned:
                    return
                self._retire()
                wait = self._duty.patience.restart if self._duty.account.taken > taken else wait
                self._fault(error, wait)
            if self._duty.over.wait(wait):
                self._duty.queue.clear()
                return
            wait = min(2 * wait, _LONGEST_WAIT)

    def _serve(self) -> None:
        """Open a sink where there is none, give it the events until the queue ends, close it."""
        with self._at_work():
            if self.sink is None:
                self.sink = self._duty.make()
                self.sink.open()
            sink, known = self.sink, self._duty.lasting()
            for event in known:
                if isinstance(event, self._duty.wants):
                    sink.take(event)
        if self.abandoned:
            return
        self._duty.account.state = "running"
        while not self.abandoned and (waiting := self._duty.queue.get()) is not None:
            if not any(waiting is one for one in known):
                self._take(sink, waiting)
        if not self.abandoned:
            sink.discard() if self._duty.discarding else sink.close()

    def _take(self, sink: Sink, event: Event) -> None:
        began = time.monotonic()
        try:
            with self._at_work():
                sink.take(event)
        except EncodingError as error:
            # Not the sink's fault: it goes on with the next event.
            self._lose(error, event)
            return
        except Exception:
            if not self.abandoned:
                self._duty.account.drop(event)
            raise
        if not self.abandoned:
            self._duty.account.taken += 1
            self._duty.longest = max(self._duty.longest, time.monotonic() - began)

    def _lose(self, error: Exception, event: Event) -> None:
        if self.abandoned:
            return
        self._duty.account.fault(str(error), state="running")
        self._duty.account.drop(event)
        if not isinstance(event, Logged):  # or it would come back
            _log.error("sink %s: %s", self._duty.name, error)

    def _fault(self, error: Exception, wait: float) -> None:
        why = str(error) or type(error).__name__
        self._duty.account.fault(why, state="restarting")
        trace = error if os.environ.get("LIDARBOOST_DEBUG") else None
        message = "sink %s failed: %s; starting it again in %.1f s"
        _log.error(message, self._duty.name, why, wait, exc_info=trace)

    def _retire(self) -> None:
        """Close a sink that failed; what it has written so far is kept."""
        sink, self.sink = self.sink, None
        if sink is None:
            return
        with suppress(Exception), self._at_work():
            sink.discard() if self._duty.discarding else sink.close()
        self._duty.account.keep(sink)

    @contextmanager
    def _at_work(self) -> Iterator[None]:
        """Note since when the thread is in the hands of its sink."""
        self.began = time.monotonic()
        try:
            yield
        finally:
            self.began = None
