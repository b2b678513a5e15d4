"""A second process that is ready already, for when the one at work dies or hangs."""

import logging
from collections.abc import Callable
from threading import Lock, Thread

from service.errors import WorkerError
from service.fusion.job import WarmUp
from service.fusion.process import fusion_process
from service.processes.worker import Worker

_START = 120.0
"""Seconds in which it has to be ready: its kernels are compiled, but it gives way to all else."""

_STILL_READY = 2.0
"""Seconds in which it has to answer when it is needed: it may have been killed or stopped itself."""

_log = logging.getLogger(__name__)


class Spare:
    """Holds at most one such process; for any thread.

    Starting one takes a second and a half of computing, half of it for imports; on a busy machine ten.

    Args:
        request: what it gets ready for.
    """

    def __init__(self, request: WarmUp) -> None:
        self._request = request
        self._lock = Lock()
        self._making: Worker | None = None
        self._ready: Worker | None = None
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Of the one that is ready."""
        ready = self._ready
        return None if ready is None else ready.pid

    def prepare(self) -> None:
        """Begin with one, in a thread of its own, where there is none."""
        with self._lock:
            if self._closed or self._making is not None or self._ready is not None:
                return
            self._making = fusion_process()
            self._making.cancelled = lambda: self._closed
        Thread(target=self._make, args=(self._making,), name="spare fusion", daemon=True).start()

    def take(self, cancelled: Callable[[], bool]) -> Worker | None:
        """The one that is ready, and still answers; whoever takes it ends it. None where there is none.

        Args:
            cancelled: from now on, once true, whatever it is waited for is given up.
        """
        with self._lock:
            worker, self._ready = self._ready, None
        if worker is None:
            return None
        worker.cancelled = cancelled
        try:
            worker.ask(self._request, _STILL_READY)
        except WorkerError as error:
            _log.warning("the spare one is of no use: %s", error)
            worker.kill()
            return None
        return worker

    def close(self) -> None:
        """End it, also one that is being made; none is made any more."""
        with self._lock:
            self._closed = True
            workers = [one for one in (self._making, self._ready) if one is not None]
            self._making = self._ready = None
        for worker in workers:
            worker.kill()

    def _make(self, worker: Worker) -> None:
        try:
            worker.start()
            worker.ask(self._request, _START)
        except (WorkerError, OSError) as error:
            if not self._closed:
                _log.warning("no spare fusion process: %s", error)
            worker.kill()
        with self._lock:
            self._making = None
            if not self._closed and worker.pid is not None:
                self._ready = worker
                return
        worker.kill()  # it was started while all was closed
