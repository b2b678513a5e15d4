"""The executor on a cluster, for which a process of this machine stands in while it is away."""

import logging
import time
from concurrent.futures import Future
from dataclasses import replace
from threading import Event, Thread
from typing import Self

from service.errors import ClusterError, WorkerError
from service.fusion.deadline import Deadline
from service.fusion.job import BurstJob, Job, WarmUp
from service.fusion.jobs import JobQueue, Listener, Queued
from service.fusion.link import Link
from service.fusion.local import LocalExecutor
from service.messages.map import FusedMap
from service.messages.status import ClusterState, FusionState
from service.processes.cluster import connected

_LOOK = 2.0
"""Seconds between two looks at the cluster in use."""

_RETRY = 5.0
"""Seconds between two attempts to reach it."""

_FLOOR = 15.0
"""Seconds that any burst may take there: others' may go first, and a new worker loads its kernels."""

_log = logging.getLogger(__name__)


class ClusterExecutor:
    """Sends the bursts of a scan to a Dask cluster; a stream stays with the process that knows its window.

    As many bursts are at work as the cluster has workers; their maps come in the order of the bursts. While
    the cluster is away, a process of this machine fuses, also what was being fused there; it is asked for
    again and again.

    Args:
        local: stands in; closed with this.
        address: of the scheduler.
        warm: what its workers are to be ready for.
    """

    def __init__(self, local: LocalExecutor, address: str, warm: WarmUp) -> None:
        self._local, self._address, self._warm = local, address, warm
        self._deadline = Deadline(_FLOOR)
        self._jobs = JobQueue[BurstJob]()
        self._at_work = self._fused = self._returned = 0
        self._link: Link | None = None
        self._error: str | None = None
        self._threads = [
            Thread(target=self._keep, name="cluster", daemon=True),
            Thread(target=self._dispatch, name="bursts", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def progress(self) -> str:
        return self._local.progress

    @property
    def ready(self) -> "Future[float]":
        """That of the process which stands in: nothing may depend on the cluster."""
        return self._local.ready

    @property
    def pid(self) -> int | None:
        """Of the process which stands in."""
        return self._local.pid

    def submit(self, job: Job, iterating: Listener = lambda _: None) -> "Future[FusedMap]":
        """Queue a job; `iterating` hears of what is fused on this machine."""
        if not isinstance(job, BurstJob):
            return self._local.submit(job, iterating)
        return self._jobs.put(job, iterating)

    @property
    def state(self) -> FusionState:
        link, local = self._link, self._local.state
        cluster = ClusterState(
            address=self._address,
            workers=0 if link is None else link.workers,
            fused=self._fused,
            returned=self._returned,
            error=self._error,
        )
        said = {"backlog": local.backlog + self._jobs.waiting, "cluster": cluster}
        return local.model_copy(update=said | {"executor": "local" if link is None else "cluster"})

    def close(self) -> None:
        self._jobs.close()
        self._local.close()
        for thread in self._threads:
            thread.join(1.0)
        self._jobs.cancel()

    def _keep(self) -> None:
        """Reach the cluster, and look after it, again and again."""
        while not self._jobs.closed:
            try:
                self._use_cluster()
            except ClusterError as error:
                self._tell_loss(str(error))
            except Exception as error:  # the library's own; the cluster is asked for again
                self._tell_loss(f"{self._address}: {type(error).__name__}: {error}")
            with self._jobs.changed:
                self._jobs.changed.wait_for(lambda: self._jobs.closed, _RETRY)

    def _use_cluster(self) -> None:
        with connected(self._address) as client:
            link = Link(client, self._address, lambda: self._jobs.closed)
            link.warm_up(self._warm)
            with self._jobs.changed:
                self._link, self._error = link, None
                self._jobs.changed.notify_all()
            _log.info("%s: bursts are fused by the cluster, %d workers", self._address, link.workers)
            try:
                while not self._jobs.closed:
                    link.look()
                    with self._jobs.changed:
                        self._jobs.changed.wait_for(lambda: self._jobs.closed or link.lost is not None, _LOOK)
                    if link.lost is not None:
                        raise ClusterError(link.lost)
            except ClusterError as error:
                self._leave(link, str(error))
                raise

    def _leave(self, link: Link, why: str) -> None:
        """Use it no more: what is being fused there is fused here."""
        with self._jobs.changed:
            link.lost = link.lost or why
            if self._link is link:
                self._link = None
            self._jobs.changed.notify_all()

    def _tell_loss(self, why: str) -> None:
        if self._jobs.closed or why == self._error:
            return
        self._error = why
        _log.warning("%s; bursts are fused on this machine meanwhile", why)

    def _dispatch(self) -> None:
        turn = Event()
        turn.set()
        while (queued := self._jobs.take(lambda: self._at_work < self._slots)) is not None:
            self._count(1)
            before, turn = turn, Event()
            Thread(target=self._serve, args=(queued, before, turn), name="burst", daemon=True).start()

    @property
    def _slots(self) -> int:
        return 1 if self._link is None else max(1, self._link.workers)

    def _count(self, more: int) -> None:
        with self._jobs.changed:
            self._at_work += more
            self._jobs.changed.notify_all()

    def _serve(self, queued: Queued[BurstJob], before: Event, after: Event) -> None:
        """Do a job; what comes of it is told once that of the job before was."""
        found: FusedMap | Exception
        try:
            found = self._done(queued.job, queued.iterating)
        except Exception as error:
            found = error
        before.wait()
        try:
            if isinstance(found, Exception):
                self._jobs.fail(queued, found)
            else:
                queued.future.set_result(found)
        finally:
            after.set()
            self._count(-1)

    def _done(self, job: BurstJob, iterating: Listener) -> FusedMap:
        link = self._link
        if link is not None:
            try:
                return self._fused_there(link, job)
            except ClusterError as error:
                if self._jobs.closed:
                    raise WorkerError("the fusion is closed") from error
                self._leave(link, str(error))
                self._returned += 1
        return self._local.submit(job, iterating).result()

    def _fused_there(self, link: Link, job: BurstJob) -> FusedMap:
        began = time.monotonic()
        found = link.fuse(job, self._deadline.of(job))
        self._deadline.learn(job, time.monotonic() - began)
        self._fused += 1
        latency = time.monotonic() - job.completed
        return replace(found, report=found.report.model_copy(update={"latency": latency}))
