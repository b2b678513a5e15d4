"""Many recordings on a Dask cluster: workers read and write the files, the scheduler hears only of names."""

import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, Queue
from time import monotonic
from typing import Any

from service.errors import ClusterError, ClusterLostError
from service.jobs.task import FileResult, FuseTask, attempted, failed
from service.processes.cluster import connected, within, workers_of
from service.processes.guest import as_guest

_LOOK = 5.0
"""Seconds without a result after which the scheduler is asked whether it is there."""

_LIMIT = 30.0
"""Seconds for a result, which is some kilobytes, to arrive."""

_LONELY = 120.0
"""Seconds without any worker after which nobody waits for one."""


def fuse_on_cluster(tasks: Sequence[FuseTask], address: str) -> Iterator[FileResult]:
    """Fuse recordings on the cluster; results come as they are done, failures among them.

    A recording whose worker is lost is done by another one; one over which workers die again and again
    fails. Every worker has to see the files under the same paths.

    Raises:
        ClusterError: as `connected`.
        ClusterLostError: the scheduler, or every worker, went away meanwhile.
    """
    with connected(address) as client:
        run = uuid.uuid4().hex
        done: Queue[Any] = Queue()
        waiting: dict[str, FuseTask] = {}
        futures = []  # one that nobody holds is given up
        for number, task in enumerate(tasks):
            key = f"lidarboost-fuse-{run}-{number}"
            waiting[key] = task
            futures.append(client.submit(fuse_alone, task, key=key, pure=False))
            futures[-1].add_done_callback(done.put)
        while waiting:
            with _loss_told():
                future = _next(done, client, address)
                result = _result(future, waiting.pop(future.key), address)
            yield result


def fuse_alone(task: FuseTask) -> FileResult:
    """On a worker: a recording's result, with one thread of the solver for each of the worker's own."""
    return as_guest(lambda: attempted(task))


def _next(done: Queue[Any], client: Any, address: str) -> Any:
    seen = monotonic()
    while True:
        try:
            future = done.get(timeout=_LOOK)
            if future.status != "pending":
                return future
            future.add_done_callback(done.put)  # its worker was lost with the result: it is done again
        except Empty:
            if workers_of(client, address):
                seen = monotonic()
            elif monotonic() - seen > _LONELY:
                raise ClusterError(f"{address}: the cluster has had no worker for {_LONELY:g} s") from None


@contextmanager
def _loss_told() -> Iterator[None]:
    try:
        yield
    except ClusterError as error:
        raise ClusterLostError(str(error)) from error


def _result(future: Any, task: FuseTask, address: str) -> FileResult:
    """What came of it; it is a worker that holds it, and the scheduler through which it is asked for."""
    if future.status == "cancelled":
        raise ClusterError(f"{address}: the connection to the scheduler was lost")
    if future.status == "finished":
        result: FileResult = within(_LIMIT, address, future.result)
        return result
    error = within(_LIMIT, address, future.exception)
    return failed(task, f"{task.path}: the worker failed over it ({type(error).__name__}: {error})")
