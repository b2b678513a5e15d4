"""The executor on this machine: maps, streams, faults, and an end that never hangs."""

import inspect
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jobs_to_fuse import SETTINGS, frame_job, job, map_of
from numba.core.caching import UserProvidedCacheLocator

from service.config.sections import FusionSection
from service.errors import HungError, WorkerError
from service.fusion.answering import answering
from service.fusion.deadline import Deadline
from service.fusion.job import Failure, WarmUp
from service.fusion.local import LocalExecutor
from service.messages.burst import Burst
from solver.runtime.caching import caches

WEDGES = Path(__file__).parents[2] / "recordings" / "wedges.mcap"


class Deadly(Burst):
    """Ends the process that receives it."""

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return os._exit, (7,)


class Endless(Burst):
    """Keeps the process that receives it."""

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return time.sleep, (60,)


def test_a_stream_whose_process_died_begins_anew_and_says_so(started: LocalExecutor) -> None:
    for number in range(3):
        map_of(started, frame_job(number, stream=3))
    assert started.pid is not None
    os.kill(started.pid, signal.SIGKILL)
    report = map_of(started, frame_job(3, stream=3)).report
    assert report.frames == 1
    assert report.notes == ("the stream began anew at frame 3: the fusion was started again",)
    assert map_of(started, frame_job(4, stream=3)).report.notes == ()


def test_a_dead_process_is_replaced_and_its_burst_fused_by_the_new_one(
    started: LocalExecutor, caplog: pytest.LogCaptureFixture
) -> None:
    before, pid = started.state.restarts, started.pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    assert map_of(started, job(1)).report.burst == 1
    assert started.state.restarts == before + 1
    assert started.pid != pid
    assert "died (signal 9)" in caplog.text


@pytest.mark.parametrize("at_work", [True, False])
def test_a_stopped_process_is_noticed_and_costs_no_burst(started: LocalExecutor, at_work: bool) -> None:
    """SIGSTOP while idle, and in the middle of a solve; four seconds is the least deadline."""
    for number in range(4):
        map_of(started, job(number))
    before, pid = started.state.hung, started.pid
    assert pid is not None
    slow = SETTINGS.model_copy(update={"upsampling": 4})
    if at_work:
        for _ in range(4):
            map_of(started, job(0, settings=slow))
        future = started.submit(job(7, settings=slow))
        os.kill(pid, signal.SIGSTOP)
    else:
        os.kill(pid, signal.SIGSTOP)
        future = started.submit(job(7))
    assert future.result(60).report.burst == 7
    if not at_work:  # it may have been done before the signal came
        assert started.state.hung == before + 1
        assert started.pid != pid
    else:
        os.kill(pid, signal.SIGCONT) if started.pid == pid else None


def test_a_process_that_hangs_while_it_starts_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.fusion.deadline._LEAST_START", 15.0)
    executor = LocalExecutor(SETTINGS)
    try:
        executor.ready.result(120)
        executor._deadline.learn_start(0.1)
        first = executor.pid
        assert first is not None
        os.kill(first, signal.SIGKILL)
        future = executor.submit(job(5))
        end = time.monotonic() + 60
        while (second := executor.pid) in (None, first):
            assert time.monotonic() < end
            time.sleep(0.001)
        assert second is not None
        os.kill(second, signal.SIGSTOP)
        assert future.result(120).report.burst == 5
        assert executor.pid not in (first, second)
        assert executor.state.restarts >= 2
        assert executor.state.hung >= 1
    finally:
        executor.close()


def test_a_burst_that_kills_twice_fails_and_the_next_is_fused(started: LocalExecutor) -> None:
    before = started.state.restarts
    bad, good = started.submit(job(0, Deadly)), started.submit(job(1))
    with pytest.raises(WorkerError, match=r"the fusion process died \(exit status 7\)"):
        bad.result(60)
    assert good.result(60).report.burst == 1
    assert started.state.restarts == before + 2


def test_a_fusion_that_never_ends_is_cut_off() -> None:
    hasty = SETTINGS.model_copy(update={"timeout": 0.3})
    executor = LocalExecutor(hasty)
    try:
        executor.ready.result(60)
        with pytest.raises(HungError, match=r"gave no answer within 0\.3 s"):
            map_of(executor, job(0, Endless, hasty))
        assert executor.state.hung == 2
    finally:
        executor.close()


def test_a_configuration_that_cannot_work_is_told_and_not_tried_again() -> None:
    executor = LocalExecutor(FusionSection.model_construct(**{**SETTINGS.model_dump(), "method": "guess"}))
    try:
        for future in (executor.ready, executor.submit(job(0)), executor.submit(job(1))):
            with pytest.raises(WorkerError, match="method 'guess' is unknown"):
                future.result(60)
        assert executor.state.restarts == 0
    finally:
        executor.close()


@pytest.mark.parametrize("after", [0.0, 0.3])
def test_closing_never_hangs_and_leaves_no_process(after: float) -> None:
    executor = LocalExecutor(SETTINGS)
    future = executor.submit(job(0))
    time.sleep(after)
    began = time.monotonic()
    executor.close()
    assert time.monotonic() - began < 8
    assert executor.pid is None
    assert future.done()


def test_a_torn_kernel_on_disk_stops_neither_the_worker_nor_fuse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering()(WarmUp(SETTINGS))  # compiled, should they not be
    copied = []
    for cache in caches():
        folder = UserProvidedCacheLocator.get_suitable_cache_subpath(inspect.getfile(cache._py_func))
        for path in cache.files[-1].folder.glob(f"{cache._impl.filename_base}.*"):
            (tmp_path / folder).mkdir(exist_ok=True, mode=0o755)
            copied.append(Path(shutil.copy(path, tmp_path / folder / path.name)))
    (torn,) = (path for path in copied if path.match("differences.thinned-*.nbi"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    config = tmp_path / "rig.toml"
    config.write_text("[fusion]\nregister_poses = false\n")  # few kernels are needed
    command = [sys.executable, "-m", "lidarboost", "fuse", WEDGES, "--method", "nearest", "--config", config]
    torn.write_bytes(b"")
    done = subprocess.run(command, capture_output=True, text=True, cwd=WEDGES.parents[1])
    assert (done.returncode, done.stderr) == (0, "")
    assert torn.stat().st_size > 0
    torn.write_bytes(b"")
    executor = LocalExecutor(SETTINGS)
    try:
        assert map_of(executor, job(0)).report.burst == 0
    finally:
        executor.close()
    assert executor.state.restarts == 0
    assert torn.stat().st_size > 0


def test_the_deadline_follows_what_is_usual_and_never_exceeds_the_limit() -> None:
    deadline, one = Deadline(), job(0)
    assert deadline.of(one) == 30.0
    for seconds in (0.3, 0.5, 0.4):
        deadline.learn(one, seconds)
    assert deadline.of(one) == pytest.approx(5.0)
    assert deadline.of(job(0, settings=SETTINGS.model_copy(update={"method": "area"}))) == 30.0
    deadline.learn(one, 60.0)
    assert deadline.of(one) == 30.0


def test_arrays_cross_the_border_unchanged_and_may_be_written_to(started: LocalExecutor) -> None:
    one = job(0)
    first = map_of(started, one)
    first.distance[:] = 0
    again = map_of(started, replace(one))
    assert np.all(again.distance != 0)
    assert first.frame.counts.dtype == np.uint16


class Unreadable(FusionSection):
    """Cannot be read by the process."""

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return int, ("not a number",)


def test_a_request_that_cannot_be_read_is_an_error_and_no_endless_wait() -> None:
    executor = LocalExecutor(Unreadable(**SETTINGS.model_dump()))
    try:
        with pytest.raises(WorkerError, match=r"the fusion process died \(exit status 1\)"):
            executor.ready.result(120)
    finally:
        executor.close()


def test_an_answer_that_is_none_is_an_error_and_no_endless_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.fusion.local.Ready", type("AnotherReady", (), {}))
    executor = LocalExecutor(SETTINGS)
    try:
        for future in (executor.ready, executor.submit(job(0))):
            with pytest.raises(WorkerError, match="another version"):
                future.result(60)
    finally:
        executor.close()


def test_a_fault_inside_a_method_says_where(monkeypatch: pytest.MonkeyPatch) -> None:
    def faulty(*_: object, **__: object) -> None:
        raise ZeroDivisionError("no frames a second")

    monkeypatch.setattr("service.fusion.answering.fuse_burst", faulty)
    answer = answering()(job(0))
    assert isinstance(answer, Failure)
    line = faulty.__code__.co_firstlineno + 1
    assert answer.reason == (
        f"internal error, ZeroDivisionError: no frames a second (test_executor.py:{line})"
    )
