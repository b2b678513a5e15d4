"""Jobs on their way to an executor: few wait, and what gives way is counted."""

import logging
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from threading import Condition

from service.errors import UnavailableError
from service.fusion.executor import Executor
from service.fusion.job import BurstJob, FrameJob, Iterating, Job
from service.messages.map import FusedMap

Done = Callable[[FusedMap | Exception], None]

_log = logging.getLogger(__name__)


class Backlog:
    """Holds at most some jobs that have not begun; live the oldest gives way, else `put` waits.

    Args:
        executor: does them.
        on_fused: called with every job that was done and its map, in a thread of the executor's.
        on_failed: called there with a job that could not be done, and why.
        on_iterating: called there now and then with a job at work, and how far the solver is.
        lossless: wait for room instead of dropping.
    """

    def __init__(
        self,
        executor: Executor,
        on_fused: Callable[[Job, FusedMap], None],
        on_failed: Callable[[Job, Exception], None],
        on_iterating: Callable[[Job, Iterating], None] = lambda *_: None,
        *,
        lossless: bool,
    ) -> None:
        self._executor, self._on_fused, self._on_failed = executor, on_fused, on_failed
        self._on_iterating = on_iterating
        self._lossless = lossless
        self._unfinished: dict[Future[FusedMap], tuple[Job, Done | None]] = {}
        self._changed = Condition()
        self.fused = self.failed = self.dropped = self.skipped = self.cancelled = 0

    def put(
        self,
        job: Job,
        room: int,
        stopping: Callable[[], bool] = lambda: False,
        done: Done | None = None,
    ) -> None:
        """Hand a job over; at most `room` jobs wait then, beside those whose map somebody waits for.

        Bursts that give way are counted as `dropped`, frames of a stream as `skipped`.

        Args:
            job: to be done.
            room: jobs that may wait.
            stopping: ends the wait for room.
            done: told the map, after `on_fused`, or why there is none.
        """
        with self._changed:
            while self._lossless and self.waiting >= room and not stopping():
                self._changed.wait(0.2)
        while self.waiting >= room and self._drop_oldest():
            pass
        future = self._executor.submit(job, lambda so_far: self._on_iterating(job, so_far))
        with self._changed:
            self._unfinished[future] = job, done
        future.add_done_callback(self._finish)

    @property
    def unfinished(self) -> int:
        """Jobs that wait or are at work."""
        return len(self._unfinished)

    @property
    def waiting(self) -> int:
        """Jobs that have not begun."""
        return sum(not future.running() and not future.done() for future in list(self._unfinished))

    def drain(self, timeout: float | None = None) -> bool:
        """Wait until every job is done; False where time ran out."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._unfinished, timeout)

    def clear(self) -> int:
        """Cancel what has not begun, which nobody wants any more; returns how many that were."""
        count = sum(future.cancel() for future in list(self._unfinished))
        self.cancelled += count
        return count

    def _drop_oldest(self) -> bool:
        for future, (job, _) in list(self._unfinished.items()):
            if not _is_awaited(job) and future.cancel():
                if isinstance(job, FrameJob):
                    self.skipped += 1
                else:
                    self.dropped += 1
                    _log.warning("burst %d dropped: the fusion does not keep up with the capture", job.number)
                return True
        return False

    def _finish(self, future: "Future[FusedMap]") -> None:
        with self._changed:
            job, done = self._unfinished[future]
        try:
            self._tell(job, future, done if done is not None else lambda _: None)
        finally:
            with self._changed:
                del self._unfinished[future]
                self._changed.notify_all()

    def _tell(self, job: Job, future: "Future[FusedMap]", done: Done) -> None:
        try:
            result = future.result()
        except CancelledError:
            self.cancelled += not future.cancelled()  # it was at work when the executor was closed
            done(UnavailableError("it was given up before its map was fused"))
        except Exception as error:
            self.failed += 1
            self._on_failed(job, error)
            done(error)
        else:
            self.fused += 1
            self._on_fused(job, result)
            done(result)


def _is_awaited(job: Job) -> bool:
    return isinstance(job, BurstJob) and job.awaited
