"""A connection to a cluster whose workers fuse bursts."""

import uuid
from collections.abc import Callable
from queue import Empty, Queue
from time import monotonic
from typing import Any

from service.errors import ClusterError
from service.fusion.job import BurstJob, Failure, WarmUp
from service.fusion.there import answer_there, packed
from service.messages.map import FusedMap
from service.processes.cluster import within, workers_of
from service.versions import software_version
from solver.errors import FusionError

_LIMIT = 10.0
"""Seconds for a scheduler that is at work to answer: a busy one lags some."""

_WARM_UP = 600.0
"""Seconds to load the kernels on every worker: a few; a minute or more where none is cached yet."""

_POLL = 0.2
"""Seconds between two looks whether the connection was given up."""

_CARRIED = {"distributed.admin.large-graph-warning-threshold": "1GB"}
"""A burst goes with its task, through the scheduler, so that any worker can do it again."""


class Link:
    """Fuses bursts over a client's connection, each at most once at a time; for many threads.

    Args:
        client: of the scheduler.
        address: of it, for messages.
        given_up: once true, whatever is waited for is given up.

    Attributes:
        lost: why nothing more comes from it; None while it works.
    """

    def __init__(self, client: Any, address: str, given_up: Callable[[], bool]) -> None:
        self._client, self._address, self._given_up = client, address, given_up
        self.workers = workers_of(client, address, _LIMIT)
        self.lost: str | None = None

    def warm_up(self, request: WarmUp) -> None:
        """Have every worker load its kernels; raises `ClusterError` where one does not."""
        said = within(_LIMIT, self._address, lambda: self._client.scheduler_info(n_workers=-1))
        futures = [self._submit(request, workers=[worker]) for worker in said["workers"]]
        end = monotonic() + _WARM_UP
        for future in futures:
            answer = self._answer(future, end - monotonic())
            if isinstance(answer, Failure):
                raise ClusterError(f"{self._address}: it cannot work as configured: {answer.reason}")

    def look(self) -> None:
        """Raise `ClusterError` where the scheduler does not answer, or has no workers left."""
        self.workers = workers_of(self._client, self._address, _LIMIT)
        if not self.workers:
            raise ClusterError(f"{self._address}: the cluster has no workers left")

    def fuse(self, job: BurstJob, timeout: float) -> FusedMap:
        """The map of a burst.

        Raises:
            FusionError: its frames cannot be fused.
            ClusterError: the cluster is gone, failed over it, or needs longer than `timeout` seconds.
        """
        answer = self._answer(self._submit(job), timeout)
        if isinstance(answer, Failure):
            raise FusionError(answer.reason)
        if not isinstance(answer, FusedMap):
            raise ClusterError(f"{self._address}: a worker answers as another version would")
        return answer

    def _submit(self, request: BurstJob | WarmUp, **where: Any) -> Any:
        from dask import config

        def submit() -> Any:
            with config.set(_CARRIED):
                return self._client.submit(
                    answer_there, software_version(), packed(request), key=key, pure=False, **where
                )

        key = f"lidarboost-burst-{uuid.uuid4().hex}"
        return within(_LIMIT, self._address, submit)

    def _answer(self, future: Any, timeout: float) -> Any:
        """What came of it; a worker that is lost with the result has another one do it again."""
        done: Queue[None] = Queue()
        future.add_done_callback(lambda _: done.put(None))
        end = monotonic() + timeout
        while True:
            self._require(monotonic() < end, f"no map within {timeout:.0f} s")
            self._require(self.lost is None, str(self.lost))
            self._require(not self._given_up(), "given up")
            try:
                done.get(timeout=_POLL)
            except Empty:
                continue
            if future.status != "pending":
                break
            future.add_done_callback(lambda _: done.put(None))
        self._require(future.status != "cancelled", "the connection to the scheduler was lost")
        if future.status == "finished":
            return within(_LIMIT, self._address, future.result)
        error = within(_LIMIT, self._address, future.exception)
        raise ClusterError(f"{self._address}: a worker failed ({type(error).__name__}: {error})")

    def _require(self, fine: bool, otherwise: str) -> None:
        if not fine:
            raise ClusterError(
                f"{self._address}: {otherwise}".removeprefix(f"{self._address}: {self._address}: ")
            )
