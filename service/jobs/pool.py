"""Many recordings on this machine: processes of ours, each with its share of the processor."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from queue import Empty, Queue
from threading import Event, Thread

from service.errors import HungError, WorkerError
from service.jobs.task import FileResult, FuseTask, attempted, failed
from service.messages.burst import Burst
from service.processes.threads import solver_threads
from service.processes.worker import Worker, tell

_SILENCE = 600.0
"""Seconds without a word, besides those that one fusion may take: a long recording is read through first,
and where no kernel is compiled yet, that takes minutes."""


@dataclass(frozen=True, slots=True)
class _Request:
    task: FuseTask
    threads: int


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


def fuse_in_pool(tasks: Sequence[FuseTask], workers: int) -> Iterator[FileResult]:
    """Fuse recordings in so many processes; results come as they are done, failures among them.

    A process that dies over a recording is replaced, and the recording tried once more.
    """
    workers = min(workers, len(tasks))
    threads = max(1, cores() // workers)
    waiting: Queue[FuseTask] = Queue()
    done: Queue[FileResult] = Queue()
    closing = Event()
    for task in tasks:
        waiting.put(task)
    members = [
        Worker(
            "fusion process",
            "service.jobs.pool:answering",
            niceness=0,
            threads=threads,
            cancelled=closing.is_set,
        )
        for _ in range(workers)
    ]
    servers = [
        Thread(target=_serve, args=(member, threads, waiting, done, closing), name="fuse", daemon=True)
        for member in members
    ]
    try:
        for server in servers:
            server.start()
        for _ in tasks:
            yield done.get()
    finally:
        closing.set()
        for member in members:
            member.kill()
        for server in servers:
            server.join(1.0)


def _serve(
    worker: Worker, threads: int, waiting: Queue[FuseTask], done: Queue[FileResult], closing: Event
) -> None:
    while not closing.is_set():
        try:
            task = waiting.get_nowait()
        except Empty:
            break
        try:
            result = _asked(worker, _Request(task, threads), closing)
        except Exception as error:  # nobody would wait for less than all results
            result = failed(task, str(error))
        done.put(result)
    worker.kill()


def _asked(worker: Worker, request: _Request, closing: Event) -> FileResult:
    """A recording's result; tried once more where the process died."""
    limit = _SILENCE + request.task.fusion.timeout
    ask: Callable[[], FileResult] = partial(worker.ask, request, limit)
    try:
        if worker.pid is None:
            worker.start()
        return ask()
    except HungError:
        worker.kill()
        raise
    except WorkerError:
        if closing.is_set():
            raise
    worker.start()
    try:
        return ask()
    except WorkerError:
        worker.kill()
        raise


def answering() -> Callable[[_Request], FileResult]:
    """What answers each request inside a process; it gives a word for every burst."""
    import cv2

    def answer(request: _Request) -> FileResult:
        cv2.setNumThreads(request.threads)
        with solver_threads(request.threads):
            return attempted(request.task, _told)

    return answer


def _told(burst: Burst) -> None:
    tell(burst.id)
