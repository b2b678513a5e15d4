"""What every executor does, whoever fuses."""

import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from pathlib import Path

import numpy as np
import pytest
from dask_cluster import dask_cluster, until
from gated import gated, waiting
from scripted import calibration, frame

from service.config.sections import Configuration, FusionSection
from service.fusion.configured import configured_executor
from service.fusion.executor import Executor
from service.fusion.job import BurstJob, FrameJob
from service.messages.burst import Burst
from service.messages.map import FusedMap
from solver.errors import FusionError

HERE = Path(__file__).parent
NOBODY = "tcp://127.0.0.1:9"
NEAREST = {"method": "nearest", "upsampling": 2, "register_poses": False, "timeout": 60.0}


def job(number: int, settings: FusionSection, **changes: object) -> BurstJob:
    frames = tuple(frame(k, k * 1000, **changes) for k in range(3))
    return BurstJob(Burst(number, frames, calibration(), 3), settings)


def frame_job(number: int, stream: int, settings: FusionSection) -> FrameJob:
    return FrameJob(frame(number, number * 1000), calibration(), settings, 3, stream, number)


def map_of(future: "Future[FusedMap]") -> FusedMap:
    return future.result(90)


@pytest.fixture(
    scope="module",
    params=["local", "stand-in", pytest.param("cluster", marks=pytest.mark.slow)],
)
def settings(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[FusionSection]:
    """Who fuses: a process here; the same for a cluster that is away; a cluster."""
    if request.param == "local":
        yield FusionSection(**NEAREST)
    elif request.param == "stand-in":
        yield FusionSection(**NEAREST, executor="cluster", cluster=NOBODY)
    else:
        with dask_cluster(tmp_path_factory.mktemp("contract") / "dask", 2, HERE) as cluster:
            yield FusionSection(**NEAREST, executor="cluster", cluster=cluster.address)


def begun(settings: FusionSection) -> Executor:
    executor = configured_executor(Configuration(fusion=settings))
    executor.ready.result(90)
    if settings.cluster not in (None, NOBODY):
        until(lambda: executor.state.executor == "cluster")
    return executor


@pytest.fixture(scope="module")
def executor(settings: FusionSection) -> Iterator[Executor]:
    with begun(settings) as started:
        yield started


def test_bursts_come_back_fused_in_order_with_their_latency(
    executor: Executor, settings: FusionSection
) -> None:
    told: list[int] = []
    futures = [executor.submit(job(number, settings)) for number in range(6)]
    for future in futures:
        future.add_done_callback(lambda done: told.append(done.result().report.burst))
    maps = [map_of(future) for future in futures]
    assert [result.report.burst for result in maps] == [0, 1, 2, 3, 4, 5]
    until(lambda: len(told) == 6)
    assert told == [0, 1, 2, 3, 4, 5]
    assert maps[0].distance.shape == (8, 12)
    assert np.allclose(maps[0].distance, 20_000 * 7.5 / 65536, atol=1e-4)
    assert maps[0].report.latency is not None
    assert 0 < maps[0].report.latency < 60
    maps[0].distance[:] = 0  # it is the receiver's


def test_a_job_carries_its_settings(executor: Executor, settings: FusionSection) -> None:
    finer = settings.model_copy(update={"upsampling": 3})
    assert map_of(executor.submit(job(0, finer))).distance.shape == (12, 18)
    assert map_of(executor.submit(job(1, settings))).distance.shape == (8, 12)


def test_a_burst_that_cannot_be_fused_is_said_so_and_the_next_is_fused(
    executor: Executor, settings: FusionSection
) -> None:
    bad = executor.submit(job(0, settings, counts=np.zeros((4, 6), np.uint16)))
    good = executor.submit(job(1, settings))
    with pytest.raises(FusionError, match="no valid pixel"):
        bad.result(90)
    assert map_of(good).report.burst == 1


def test_a_stream_fuses_its_window_and_another_number_begins_anew(
    executor: Executor, settings: FusionSection
) -> None:
    reports = [map_of(executor.submit(frame_job(number, 1, settings))).report for number in range(5)]
    assert [report.frames for report in reports] == [1, 2, 3, 3, 3]
    assert reports[4].sequence == (2, 3, 4)
    assert [report.burst for report in reports] == [0, 1, 2, 3, 4]
    assert not any(report.notes for report in reports)
    assert map_of(executor.submit(frame_job(0, 2, settings))).report.frames == 1


def test_what_waits_is_counted_and_can_be_cancelled(
    executor: Executor, settings: FusionSection, tmp_path: Path
) -> None:
    futures = [executor.submit(gated(number, tmp_path, settings)) for number in range(4)]
    until(lambda: bool(waiting(tmp_path, 0)))
    assert executor.state.backlog >= 2
    assert futures[3].cancel()
    assert not futures[0].cancel()
    (tmp_path / "open").touch()
    assert [map_of(future).report.burst for future in futures[:3]] == [0, 1, 2]
    assert waiting(tmp_path, 3) == []
    until(lambda: executor.state.backlog == 0)


def test_closing_never_hangs_and_leaves_no_future_undone(settings: FusionSection, tmp_path: Path) -> None:
    executor = begun(settings)
    futures = [executor.submit(gated(number, tmp_path, settings)) for number in range(4)]
    until(lambda: bool(waiting(tmp_path, 0)))
    began = time.monotonic()
    executor.close()
    assert time.monotonic() - began < 8
    (tmp_path / "open").touch()  # for those who still wait
    for future in futures:
        with pytest.raises(CancelledError):
            future.result(10)
