"""The queue of an executor: bursts and windows that wait to be fused."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field
from threading import Condition
from typing import Generic, TypeVar

from service.errors import WorkerError
from service.fusion.job import Iterating, Job
from service.messages.map import FusedMap

J = TypeVar("J", bound=Job)

Listener = Callable[[Iterating], None]
"""Told how far the solver is."""


@dataclass(frozen=True)
class Queued(Generic[J]):
    """A job, the promise of its map, and who hears of the iterations meanwhile."""

    job: J
    iterating: Listener
    future: Future[FusedMap] = field(default_factory=Future)


class JobQueue(Generic[J]):
    """First in, first out; what was cancelled while it waited is passed over.

    Attributes:
        changed: notified when a job comes and when the queue closes; whoever changes what a taker waits for
            notifies it, too.
        closed: no job is given out any more.
    """

    def __init__(self) -> None:
        self.changed = Condition()
        self.closed = False
        self._jobs: deque[Queued[J]] = deque()

    def put(self, job: J, iterating: Listener) -> Future[FusedMap]:
        queued = Queued(job, iterating)
        with self.changed:
            waiting = [other for other in self._jobs if not other.future.cancelled()]
            self._jobs = deque([*waiting, queued])
            self.changed.notify_all()
        return queued.future

    def take(self, free: Callable[[], bool] = lambda: True) -> Queued[J] | None:
        """The next job, once there is one and `free` holds, its future running; None when closed."""
        with self.changed:
            while True:
                self.changed.wait_for(lambda: self.closed or (bool(self._jobs) and free()))
                if self.closed:
                    return None
                queued = self._jobs.popleft()
                if queued.future.set_running_or_notify_cancel():
                    return queued

    @property
    def waiting(self) -> int:
        """How many jobs nobody has taken or cancelled."""
        return sum(not queued.future.cancelled() for queued in list(self._jobs))

    def close(self) -> None:
        """Wake whoever waits; the jobs left are cancelled by `cancel`, once the takers are done."""
        with self.changed:
            self.closed = True
            self.changed.notify_all()

    def fail(self, queued: Queued[J], error: Exception) -> None:
        """Say why a job could not be done; one whose worker was ended by closing was given up as well."""
        given_up = self.closed and isinstance(error, WorkerError)
        queued.future.set_exception(CancelledError() if given_up else error)

    def cancel(self) -> None:
        """Cancel what still waits."""
        for queued in list(self._jobs):
            queued.future.cancel()
