"""Runs one sink apart from everything else: its queue, its thread, its restarts."""

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from threading import Event as Flag
from threading import Lock, Thread
from typing import Literal

from drivers.errors import DriverError
from service.errors import EncodingError, ServiceError, SinkError
from service.messages.events import Event, Logged
from service.messages.status import SinkState
from service.sinks.attempt import Attempt
from service.sinks.queue import BoundedQueue
from service.sinks.sink import Sink

_PATIENCE = 10.0
"""Seconds that a sink may hold back a lossless run before it is failed."""

_HANG, _TIMES_USUAL = 10.0, 10.0
"""A sink hangs that works on one event for that many seconds and that many times as long as ever before."""

_ABANDONED = 3
"""Hanging threads at most; then the sink waits until they come back."""

_FIRST_WAIT, _LONGEST_WAIT = 0.5, 30.0
"""Seconds before the first restart, and at most between later ones."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Patience:
    """Seconds: that a lossless run is held back, that an event may take, before the first restart."""

    held: float = _PATIENCE
    hang: float = _HANG
    restart: float = _FIRST_WAIT


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
        patience: Patience = Patience(),
    ) -> None:
        self.name = name
        self._make, self._lasting, self._lossless, self._patience = make, lasting, lossless, patience
        self._worth: Callable[[Event], int] = lambda _: 1
        self._unit = "events"
        self._wants: tuple[type[Event], ...] = (Event,)
        self._state: Literal["running", "restarting", "failed", "ended"] = "running"
        self._taken = self._dropped = self._faults = self._abandoned = self._told = 0
        self._longest = self._slowest = 0.0
        self._hanging: list[Thread] = []
        self._error: str | None = None
        self._files: list[str] = []
        self._losses: list[str] = []
        self._discarding = self._may_skip = self._waits = False
        self._over = Flag()
        self._lock = Lock()

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
        self._may_skip = sink.newest_suffice and not self._lossless
        self._unit, self._worth = sink.unit, sink.worth
        self._queue: BoundedQueue[Event] = BoundedQueue(
            sink.room.events,
            sink.room.size,
            dropped=self._drop,
            droppable=lambda event: isinstance(event, sink.droppable),
        )
        self._begin(sink if must_open else None)

    def put(self, event: Event) -> None:
        """Hand an event over; waits only in a lossless run, and never for long."""
        if not isinstance(event, self._wants):
            return
        if self._state == "failed":
            self._drop(event)
        elif self._lossless and event.patient:
            if not self._queue.put_patiently(event, event.size, self._patience.held):
                self._drop(event)
                self._give_up(f"it held the run back for {self._patience.held:g} s")
        else:
            self._queue.put(event, event.size)

    def watch(self) -> None:
        """Give up a thread that hangs, and begin another; to be called now and then."""
        attempt, now = self._attempt, time.monotonic()
        limit = max(self._patience.hang, self._slowest, _TIMES_USUAL * self._longest)
        if attempt.began is not None and now - attempt.began > limit and self._state != "failed":
            self._abandon(f"it hung for {now - attempt.began:.0f} s")
            self._begin_unless_all_hang()
        elif self._waits:
            self._begin_unless_all_hang()
        dropped = self.state.dropped
        if dropped > self._told and not self._may_skip:
            _log.warning("sink %s: %d %s lost so far", self.name, dropped, self._unit)
            self._told = dropped

    def _begin_unless_all_hang(self) -> None:
        """Begin another thread, where not too many hang; what hung on a disk or a share may come back."""
        self._hanging = [thread for thread in self._hanging if thread.is_alive()]
        if len(self._hanging) < _ABANDONED:
            self._waits = False
            self._begin(None)
        elif not self._waits:
            self._waits, self._state = True, "failed"
            self._error = f"it hung {self._abandoned} times; it goes on once what it waits for comes back"
            _log.error("sink %s: %s", self.name, self._error)
            self._queue.clear()

    def end(self, *, discard: bool = False) -> None:
        """Take nothing more, work off what waits and finish; or leave nothing behind."""
        self._discarding = discard
        if discard:
            self._queue.clear()
        self._over.set()
        self._queue.close()

    def close(self, timeout: float, *, discard: bool = False) -> None:
        """End it, and give it up where that takes longer than `timeout` seconds."""
        self.end(discard=discard)
        failed = self._state == "failed"
        if not self._attempt.abandoned:
            self._join(min(timeout, self._patience.held) if failed else timeout)
            if self._thread.is_alive():
                self._abandon(f"it did not finish within {timeout:.0f} s")
                self._queue.clear()
        self._state = "failed" if failed else "ended"

    def _join(self, timeout: float) -> None:
        """Wait for the thread, in a lossless run for as long as it gets on with its work."""
        while True:
            taken = self._taken
            self._thread.join(timeout)
            if not (self._thread.is_alive() and self._lossless and self._taken > taken):
                return

    @property
    def sink(self) -> Sink | None:
        """The one at work."""
        return self._attempt.sink

    @property
    def state(self) -> SinkState:
        """How it is doing; one that is at fault and tries again by itself counts as restarting."""
        sink = self.sink
        fault = sink.fault if sink is not None and self._state == "running" else None
        return SinkState(
            name=self.name,
            state=self._state if fault is None else "restarting",
            waiting=len(self._queue),
            taken=self._taken,
            dropped=self._dropped + (0 if sink is None else sink.lost),
            faults=self._faults,
            abandoned=self._abandoned,
            error=fault or self._error,
        )

    @property
    def files(self) -> list[str]:
        """What its sinks have written, complete."""
        sink = self.sink
        return self._files + list(sink.files if sink is not None else ())

    @property
    def losses(self) -> list[str]:
        """What was lost to it, in words; complete once it is closed."""
        sink = self.sink
        said = self._losses + list(sink.losses if sink is not None else ())
        skipped_only = self._may_skip and not self._faults
        dropped = self.state.dropped
        if (dropped and not skipped_only) or self._state == "failed":
            why = f" ({self._error})" if self._error else ""
            said.append(f"{self.name}: {dropped} {self._unit} lost{why}")
        return said

    def _begin(self, sink: Sink | None) -> None:
        self._attempt = Attempt(sink)
        self._thread = Thread(target=self._run, args=(self._attempt,), name=self.name, daemon=True)
        self._thread.start()

    def _run(self, attempt: Attempt) -> None:
        wait = self._patience.restart
        while not attempt.abandoned:
            taken = self._taken
            try:
                self._serve(attempt)
                return
            except Exception as error:  # whatever a sink raises stays here
                if attempt.abandoned:
                    return
                self._retire(attempt)
                wait = self._patience.restart if self._taken > taken else wait
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
        self._state = "running"
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
                self._drop(event)
            raise
        if not attempt.abandoned:
            self._taken += 1
            self._longest = max(self._longest, time.monotonic() - began)

    def _lose(self, attempt: Attempt, error: Exception, event: Event) -> None:
        if attempt.abandoned:
            return
        self._faults += 1
        self._error = str(error)
        self._drop(event)
        if not isinstance(event, Logged):  # or it would come back
            _log.error("sink %s: %s", self.name, error)

    def _fault(self, error: Exception, wait: float) -> None:
        self._faults += 1
        self._error = str(error) or type(error).__name__
        self._state = "restarting"
        _log.error("sink %s failed: %s; starting it again in %.1f s", self.name, self._error, wait)

    def _retire(self, attempt: Attempt) -> None:
        """Close a sink that failed; what it has written so far is kept."""
        sink, attempt.sink = attempt.sink, None
        if sink is None:
            return
        with suppress(Exception), attempt.at_work():
            sink.discard() if self._discarding else sink.close()
        self._keep(sink)

    def _keep(self, sink: Sink) -> None:
        with suppress(Exception):
            self._files += sink.files
            self._losses += sink.losses
            self._dropped += sink.lost

    def _abandon(self, why: str) -> None:
        attempt = self._attempt
        attempt.abandoned, attempt.began = True, None
        sink, attempt.sink = attempt.sink, None
        if sink is not None:
            sink.abandoned.set()
            with suppress(Exception):
                sink.abandon()
            self._keep(sink)
        self._hanging = [thread for thread in (*self._hanging, self._thread) if thread.is_alive()]
        self._abandoned += 1
        self._faults += 1
        self._dropped += 1
        self._error, self._state = why, "restarting"
        _log.error("sink %s was given up: %s", self.name, why)

    def _give_up(self, why: str) -> None:
        self._state, self._error = "failed", why
        _log.error("sink %s is given up for good: %s", self.name, why)
        self._over.set()
        self._queue.close()
        self._queue.clear()

    def _drop(self, event: Event) -> None:
        worth = self._worth(event)
        with self._lock:
            self._dropped += worth
