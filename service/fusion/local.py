"""The executor on this machine: one process, which can neither stall the capture nor end the daemon."""

import logging
import time
from concurrent.futures import Future
from dataclasses import replace
from threading import Thread
from typing import Self

from service.config.sections import FusionSection
from service.errors import HungError, WorkerError
from service.fusion.deadline import Deadline
from service.fusion.job import Answer, Compiling, Failure, Job, Ready, WarmUp
from service.fusion.jobs import JobQueue, Listener
from service.fusion.process import fusion_process
from service.fusion.spare import Spare
from service.messages.map import FusedMap
from service.messages.status import FusionState
from service.processes.worker import Worker
from solver.errors import FusionError

_BETWEEN_WORDS = 3.0
"""Seconds between two words on how many kernels are compiled; loading all of them takes less."""

_STARTS = 3
"""Starts in a row that may fail before the executor is given up."""

_PROVEN = 3
"""Maps after which a spare one is made ready: the first ones shall not wait for it."""

_log = logging.getLogger(__name__)


class LocalExecutor:
    """Fuses job after job in a process of low priority.

    A process that dies or hangs is replaced, and its job is done again.

    Args:
        settings: what to be ready for; `timeout` bounds each job.
        window: of the stream to be ready for; None = bursts only.
        worker: the process, which may have been started already.
        spare: whether a second one is kept ready, once the first has proven its worth.
    """

    def __init__(
        self,
        settings: FusionSection,
        window: int | None = None,
        worker: Worker | None = None,
        *,
        spare: bool = False,
    ) -> None:
        self._request = WarmUp(settings, window)
        self._spare = Spare(self._request) if spare else None
        self._answered = 0
        self._worker = fusion_process() if worker is None else worker
        self._worker.cancelled = lambda: self._jobs.closed
        self._deadline = Deadline()
        self._jobs = JobQueue[Job]()
        self._restarts = self._hung = 0
        self._error: str | None = None
        self._told = time.monotonic()
        self.progress = "loads its kernels"
        """What it does until it is ready, in words."""
        self.ready: Future[float] = Future()
        """Seconds that it took until the kernels were ready; raises `WorkerError` where it was given up."""
        self._thread = Thread(target=self._run, name="fusion", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(self, job: Job, iterating: Listener = lambda _: None) -> "Future[FusedMap]":
        """Queue a job; `iterating` is called in this executor's thread."""
        return self._jobs.put(job, iterating)

    @property
    def state(self) -> FusionState:
        return FusionState(
            backlog=self._jobs.waiting,
            restarts=self._restarts,
            hung=self._hung,
            spare=self.spare_pid is not None,
            error=self._error,
        )

    @property
    def pid(self) -> int | None:
        """Of the process at work."""
        return self._worker.pid

    @property
    def spare_pid(self) -> int | None:
        """Of the one that stands ready."""
        return None if self._spare is None else self._spare.pid

    def close(self) -> None:
        self._jobs.close()
        if self._spare is not None:
            self._spare.close()
        self._worker.kill()
        self._thread.join(1.0)
        self._jobs.cancel()

    def _run(self) -> None:
        fatal: Exception | None = None
        try:
            self.ready.set_result(self._start())
        except Exception as error:  # whatever it is, whoever waits must hear of it
            fatal = error
            self.ready.set_exception(error)
        while (queued := self._jobs.take()) is not None:
            try:
                queued.future.set_result(self._done(queued.job, queued.iterating, fatal))
            except Exception as error:
                self._jobs.fail(queued, error)
        self._worker.kill()

    def _done(self, job: Job, iterating: Listener, fatal: Exception | None) -> FusedMap:
        """A job's map; tried once more where the process died or hung over it."""
        if fatal is not None:
            raise fatal
        if self._worker.pid is None:
            self._start()
        try:
            return self._asked(job, iterating, self._deadline.of(job))
        except WorkerError as error:
            self._renew(job, error)
        try:
            return self._asked(job, iterating, self._deadline.again(job))
        except WorkerError as error:
            self._renew(job, error)
            raise

    def _asked(self, job: Job, iterating: Listener, timeout: float) -> FusedMap:
        began = time.monotonic()
        answer: Answer = self._worker.ask(job, timeout, iterating, renewed=False)
        if isinstance(answer, Failure):
            raise FusionError(answer.reason)
        assert isinstance(answer, FusedMap)
        self._error = None
        self._deadline.learn(job, time.monotonic() - began)
        self._answered += 1
        if self._spare is not None and self._answered >= _PROVEN:
            self._spare.prepare()
        latency = time.monotonic() - job.completed
        return replace(answer, report=answer.report.model_copy(update={"latency": latency}))

    def _renew(self, job: Job, error: WorkerError) -> None:
        if self._jobs.closed:
            raise error
        self._restarts += 1
        self._hung += isinstance(error, HungError)
        self._error = str(error)
        self._answered = 0
        spare = None if self._spare is None else self._spare.take(lambda: self._jobs.closed)
        if spare is None:
            _log.error("%s over number %d; it is started again", error, job.number)
            self._start()
            return
        _log.error("%s over number %d; the spare one takes its place", error, job.number)
        self._worker.kill()
        self._worker = spare
        if self._jobs.closed:
            spare.kill()

    def _compiling(self, so_far: Compiling) -> None:
        """Say how far it is, now and then."""
        now = time.monotonic()
        if now - self._told >= _BETWEEN_WORDS:
            self._told = now
            self.progress = f"compiles its kernels, once on this machine: {so_far.kernels} of {so_far.total}"
            _log.info("the fusion %s", self.progress)

    def _start(self) -> float:
        """Start the process and have it ready; raises `WorkerError` where that cannot be done."""
        for attempt in range(1, _STARTS + 1):
            try:
                if not self._worker.is_fresh:
                    self._worker.start()
                answer: Answer = self._worker.ask(self._request, self._deadline.of_start(), self._compiling)
            except WorkerError as error:
                if attempt == _STARTS or self._jobs.closed:
                    self._worker.kill()
                    raise
                self._restarts += 1
                self._hung += isinstance(error, HungError)
                _log.error("%s; starting it again", error)
                continue
            if isinstance(answer, Failure):
                self._worker.kill()
                raise WorkerError(f"the fusion cannot work as configured: {answer.reason}")
            if not isinstance(answer, Ready):
                self._worker.kill()
                raise WorkerError("the fusion process answers as another version would: install it anew")
            self._deadline.learn_start(answer.seconds)
            _log.info("fusion ready after %.1f s", answer.seconds)
            return answer.seconds
        raise AssertionError("unreachable")
