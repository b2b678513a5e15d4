"""Bursts and frames on their way to maps: what becomes of them is told as events."""

import logging
from collections.abc import Callable, Iterator, Sequence
from math import isfinite
from threading import Event as Flag

import numpy as np
from numpy.typing import NDArray

from service.errors import ServiceError
from service.fusion.backlog import Backlog
from service.fusion.executor import Executor
from service.fusion.job import FrameJob, Iterating, Job
from service.messages.events import Event, FusionFailed, MapFused, SolverAdvanced
from service.messages.map import FusedMap
from service.messages.progress import SolverProgress

_log = logging.getLogger(__name__)


class Fusing:
    """An executor and what waits for it.

    Args:
        executor: fuses; whoever made it closes it, but nothing comes from it after `close`.
        emit: told of every map, and of every job without one.
        lossless: nothing is dropped; whoever is faster waits.

    Attributes:
        truth: (βH, βW) true distance of the first view, metres, or None.
    """

    def __init__(self, executor: Executor, emit: Callable[[Event], None], *, lossless: bool) -> None:
        self.executor = executor
        self.backlog = Backlog(self.executor, self._fused, self._failed, self._iterating, lossless=lossless)
        self.truth: NDArray[np.float32] | None = None
        self._emit = emit
        self._streams = 0
        self._moved: int | None = None

    def waiting(self, stop: Flag) -> Iterator[str]:
        """What is done until the kernels are compiled; raises `WorkerError` where the fusion was given up."""
        while not stop.is_set():
            yield self.executor.progress
            try:
                self.executor.ready.result(timeout=0.2)
                return
            except TimeoutError:
                continue

    def finish(self, timeout: float | None) -> None:
        """Do what is left, or what can be done of it within `timeout` seconds."""
        if not self.backlog.drain(timeout) and (left := self.backlog.unfinished):
            self.backlog.clear()
            _log.info("%d not fused: the service was stopped", left)

    def close(self) -> None:
        """End the process that fuses, whatever it does: nothing comes from it any more."""
        self.executor.close()

    def next_stream(self) -> int:
        """The number of a stream that begins; its grid is that of the first view."""
        self._streams += 1
        return self._streams

    def require_map(self, failures: Sequence[str]) -> None:
        """Raise `ServiceError` unless there was one map."""
        if self.backlog.fused == 0:
            raise ServiceError(f"no burst could be fused: {failures[-1] if failures else 'there was none'}")

    def _fused(self, job: Job, result: FusedMap) -> None:
        # The truth is that of the first view: a stream whose grid has moved has none.
        stream = job.stream if isinstance(job, FrameJob) else None
        if stream is not None and result.report.notes:
            self._moved = stream
        moved = stream is not None and stream == self._moved
        self._emit(MapFused(result, None if moved else self.truth))

    def _iterating(self, job: Job, so_far: Iterating) -> None:
        told = so_far.objective
        known = told if told is not None and isfinite(told) else None
        self._emit(
            SolverAdvanced(
                SolverProgress(burst=job.number, iteration=so_far.iteration, objective=known, gap=so_far.gap)
            )
        )

    def _failed(self, job: Job, error: Exception) -> None:
        _log.error("number %d could not be fused: %s", job.number, error)
        self._emit(FusionFailed(job.number, str(error)))
