"""The fusion in a process of its own, so that it can neither stall the capture nor take the daemon down."""

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Condition, Thread

from service.config.sections import FusionSection
from service.errors import WorkerError
from service.fusion.fuse import FusedBurst
from service.fusion.process import FusionProcess
from service.fusion.serving import Failure
from service.messages.burst import Burst

_STARTS = 3
"""Starts in a row that may fail before the worker is given up."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class WorkerCounts:
    """What happened so far: bursts fused, failed (with the reason reported), dropped from the full queue;
    processes that had to be started again; the last fault in words."""

    fused: int = 0
    failed: int = 0
    dropped: int = 0
    restarts: int = 0
    error: str = ""


class FusionWorker:
    """A queue of bursts, a process that fuses them one by one, and a thread that looks after it.

    Args:
        settings: how to fuse, how many bursts may wait, how long one may take.
        on_fused: called in the worker's thread with every map.
        on_failed: called there with a burst that could not be fused, and why.
        lossless: `submit` waits while the queue is full; otherwise the oldest burst is dropped and counted.
    """

    def __init__(
        self,
        settings: FusionSection,
        on_fused: Callable[[FusedBurst], None],
        on_failed: Callable[[Burst, str], None] = lambda _burst, _reason: None,
        *,
        lossless: bool = False,
    ) -> None:
        self.counts = WorkerCounts()
        self.fatal: Exception | None = None
        self._settings, self._lossless = settings, lossless
        self._on_fused, self._on_failed = on_fused, on_failed
        self._queue: deque[Burst] = deque()
        self._changed = Condition()
        self._ready = self._busy = self._closing = False
        self._process = FusionProcess(settings, lambda: self._closing)
        self._thread = Thread(target=self._run, name="fusion", daemon=True)

    def start(self) -> None:
        """Start the process; it warms its kernels up while bursts may already be submitted."""
        self._thread.start()

    def submit(self, burst: Burst) -> None:
        """Queue a burst.

        Raises:
            WorkerError: the worker was given up.
        """
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: self._has_room() or self._ended())
            elif not self._has_room():
                lost = self._queue.popleft()
                self.counts.dropped += 1
                _log.warning("burst %d dropped: the fusion is slower than the capture", lost.id)
            self._check()
            self._queue.append(burst)
            self._changed.notify_all()

    def wait_ready(self, stopping: Callable[[], bool]) -> None:
        """Wait until the kernels are compiled, or `stopping` becomes true.

        Raises:
            WorkerError: the worker was given up.
        """
        with self._changed:
            while not (self._ready or self._ended() or stopping()):
                self._changed.wait(0.2)
            self._check()

    @property
    def waiting(self) -> int:
        """Bursts in the queue."""
        return len(self._queue)

    def drain(self, timeout: float | None = None) -> bool:
        """Wait until every burst submitted has been fused or reported; False where time ran out.

        Raises:
            WorkerError: the worker was given up.
        """
        with self._changed:
            done = self._changed.wait_for(lambda: self._idle() or self._ended(), timeout)
            self._check()
            return done

    def close(self) -> None:
        """End the process; what still waits is dropped. Never waits longer than a few seconds."""
        with self._changed:
            self._closing = True
            self.counts.dropped += len(self._queue)
            self._queue.clear()
            self._changed.notify_all()
        self._process.kill()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def _has_room(self) -> bool:
        return len(self._queue) < self._settings.backlog

    def _idle(self) -> bool:
        return not self._queue and not self._busy

    def _ended(self) -> bool:
        return self._closing or self.fatal is not None

    def _check(self) -> None:
        if self.fatal is not None:
            raise WorkerError(str(self.fatal)) from self.fatal
        if self._closing:
            raise WorkerError("the fusion worker is closed")

    def _run(self) -> None:
        try:
            self._ensure_process()
            with self._changed:
                self._ready = True
                self._changed.notify_all()
            while (burst := self._take()) is not None:
                self._fuse(burst)
                with self._changed:
                    self._busy = False
                    self._changed.notify_all()
        except Exception as error:
            if not self._closing:
                _log.error("fusion worker given up: %s", error)
                with self._changed:
                    self.fatal = error
                    self._changed.notify_all()
        finally:
            self._process.kill()

    def _take(self) -> Burst | None:
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closing)
            if self._closing:
                return None
            self._busy = True
            burst = self._queue.popleft()
            self._changed.notify_all()
            return burst

    def _fuse(self, burst: Burst) -> None:
        """Fuse, once more where the process died over it; a result or a reason is reported in any case."""
        for attempt in (1, 2):
            try:
                answer = self._process.fuse(burst)
            except WorkerError as error:
                if self._closing:
                    return
                _log.error("burst %d, attempt %d: %s", burst.id, attempt, error)
                self.counts.error = str(error)
                self.counts.restarts += 1
                self._ensure_process()
                reason = str(error)
            else:
                if isinstance(answer, FusedBurst):
                    self.counts.fused += 1
                    self._on_fused(_timed(answer, burst))
                    return
                reason = answer.reason
                break
        self.counts.failed += 1
        self.counts.error = reason
        self._on_failed(burst, reason)

    def _ensure_process(self) -> None:
        for attempt in range(1, _STARTS + 1):
            try:
                answer = self._process.start()
            except WorkerError as error:
                if attempt == _STARTS or self._closing:
                    raise
                self.counts.restarts += 1
                _log.error("%s; starting it again", error)
                continue
            if isinstance(answer, Failure):
                raise WorkerError(f"the fusion cannot work as configured: {answer.reason}")
            _log.info("fusion worker ready after %.1f s", answer.seconds)
            return


def _timed(result: FusedBurst, burst: Burst) -> FusedBurst:
    latency = time.monotonic() - burst.completed
    return replace(result, report=result.report.model_copy(update={"latency": latency}))
