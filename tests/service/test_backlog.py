"""What waits for an executor: who gives way, what listeners do, and which maps have a truth."""

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest
from jobs_to_fuse import frame_job, job, map_of

from service.daemon.fusing import Fusing
from service.fusion.backlog import Backlog
from service.fusion.job import Job
from service.fusion.local import LocalExecutor
from service.messages.map import FusedMap
from service.messages.status import FusionState


class Held:
    """An executor whose jobs wait until they are done by hand."""

    def __init__(self) -> None:
        self.jobs: list[tuple[Job, Future[FusedMap]]] = []

    def submit(self, job: Job, iterating: object = None) -> "Future[FusedMap]":  # noqa: ARG002
        self.jobs.append((job, Future()))
        return self.jobs[-1][1]

    @property
    def state(self) -> FusionState:
        return FusionState(backlog=0, restarts=0, hung=0, error=None)

    def close(self) -> None: ...


def test_live_the_oldest_burst_gives_way_when_the_backlog_is_full() -> None:
    held = Held()
    backlog = Backlog(held, lambda _job, _map: None, lambda _job, _why: None, lossless=False)
    for number in range(5):
        backlog.put(job(number), room=2)
    waiting = [one.number for one, future in held.jobs if not future.cancelled()]
    assert waiting == [3, 4]
    assert (backlog.dropped, backlog.skipped) == (3, 0)
    for number in range(5):
        backlog.put(frame_job(number), room=1)
    assert backlog.dropped == 5
    assert backlog.skipped == 4
    assert not backlog.drain(0.0)
    assert backlog.clear() == 1
    assert (backlog.dropped, backlog.skipped, backlog.cancelled) == (5, 4, 1)
    assert backlog.drain(1.0)


def test_a_stream_whose_grid_moved_has_no_truth_and_what_is_scanned_after_it_has(
    started: LocalExecutor,
) -> None:
    held, told = Held(), []
    fusing = Fusing(held, told.append, lossless=False)  # type: ignore[arg-type]
    fusing.truth = np.ones((1, 1), np.float32)
    still = map_of(started, job(0))
    moved = replace(still, report=still.report.model_copy(update={"notes": ("the grid moved",)}))
    first, second = fusing.next_stream(), fusing.next_stream()
    jobs = [
        (replace(frame_job(0), stream=first), still),
        (replace(frame_job(1), stream=first), moved),
        (replace(frame_job(2), stream=first), still),
        (job(0), still),
        (replace(frame_job(3), stream=first), still),
        (replace(frame_job(0), stream=second), still),
    ]
    for one, result in jobs:
        fusing.backlog.put(one, room=10)
        held.jobs[-1][1].set_result(result)
    assert [event.truth is not None for event in told] == [True, False, False, True, False, True]


def test_what_its_listeners_raise_stops_nobody(
    started: LocalExecutor, caplog: pytest.LogCaptureFixture
) -> None:
    seen: list[int] = []

    def listen(_: Job, result: FusedMap) -> None:
        seen.append(result.report.burst)
        raise RuntimeError("no wish to listen")

    backlog = Backlog(started, listen, lambda _job, _why: None, lossless=True)
    for number in range(4):
        backlog.put(job(number), room=1)
    assert backlog.drain(60)
    assert seen == [0, 1, 2, 3]
    assert "no wish to listen" in caplog.text
