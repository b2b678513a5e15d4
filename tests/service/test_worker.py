"""The fusion worker: results, faults, full queues, and an end that never hangs."""

import inspect
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numba.core.caching import UserProvidedCacheLocator
from scripted import calibration, frame

from service.capture.burst import Burst
from service.config import FusionSection
from service.errors import WorkerError
from service.fusion import serving
from service.fusion.fusion import FusedBurst
from service.fusion.worker import FusionWorker
from solver.kernels.caching import caches

WEDGES = Path(__file__).parents[2] / "recordings" / "wedges.mcap"

SETTINGS = FusionSection(method="nearest", upsampling=2, register_poses=False, timeout=20.0)


class Watched:
    """A worker and what it reported."""

    def __init__(self, settings: FusionSection = SETTINGS, *, lossless: bool = True) -> None:
        self.fused: list[FusedBurst] = []
        self.failed: list[tuple[int, str]] = []
        self.worker = FusionWorker(
            settings, self.fused.append, lambda b, why: self.failed.append((b.id, why)), lossless=lossless
        )

    def run(self, *bursts: Burst) -> None:
        for burst in bursts:
            self.worker.submit(burst)
        assert self.worker.drain(60)


class Deadly(Burst):
    """Ends the process that receives it."""

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return os._exit, (7,)


class Endless(Burst):
    """Keeps the process that receives it."""

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return time.sleep, (60,)


def burst(number: int, kind: type[Burst] = Burst, **changes: object) -> Burst:
    return kind(number, tuple(frame(k, k * 1000, **changes) for k in range(3)), calibration(), 3)


@pytest.fixture(scope="module")
def started() -> Iterator[Watched]:
    watched = Watched()
    watched.worker.start()
    yield watched
    watched.worker.close()


@pytest.fixture
def watched(started: Watched) -> Watched:
    started.fused.clear()
    started.failed.clear()
    return started


def test_bursts_come_back_fused_in_order_with_their_latency(watched: Watched) -> None:
    watched.run(*(burst(k) for k in range(5)))
    assert [r.report.burst for r in watched.fused] == [0, 1, 2, 3, 4]
    result = watched.fused[0]
    assert result.distance.shape == (8, 12)
    assert np.allclose(result.distance, 20_000 * 7.5 / 65536, atol=1e-4)
    assert result.report.latency is not None
    assert 0 < result.report.latency < 60


def test_a_burst_that_cannot_be_fused_is_reported_and_the_next_is_fused(watched: Watched) -> None:
    watched.run(burst(0, counts=np.zeros((4, 6), np.uint16)), burst(1))
    assert [number for number, _ in watched.failed] == [0]
    assert "no valid pixel" in watched.failed[0][1]
    assert [r.report.burst for r in watched.fused] == [1]


def test_a_dead_process_is_replaced_and_its_burst_fused_by_the_new_one(watched: Watched) -> None:
    before = watched.worker.counts.restarts
    watched.run(burst(0))
    pid = watched.worker._process._process.pid
    os.kill(pid, signal.SIGKILL)
    watched.run(burst(1))
    assert [r.report.burst for r in watched.fused] == [0, 1]
    assert watched.worker.counts.restarts == before + 1
    assert watched.worker._process._process.pid != pid
    assert "signal 9" in watched.worker.counts.error


def test_a_burst_that_kills_twice_is_reported_and_the_next_is_fused(watched: Watched) -> None:
    before = watched.worker.counts.restarts
    watched.run(burst(0, Deadly), burst(1))
    assert watched.failed == [(0, "the fusion worker died (exit status 7)")]
    assert [r.report.burst for r in watched.fused] == [1]
    assert watched.worker.counts.restarts == before + 2


def test_a_fusion_that_never_ends_is_cut_off() -> None:
    watched = Watched(SETTINGS.model_copy(update={"timeout": 0.3}))
    watched.worker.start()
    try:
        watched.run(burst(0, Endless))
        assert watched.failed == [(0, "the fusion worker gave no answer within 0.3 s")]
    finally:
        watched.worker.close()


def test_a_configuration_that_cannot_work_is_told_and_not_tried_again() -> None:
    watched = Watched(FusionSection.model_construct(**{**SETTINGS.model_dump(), "method": "guess"}))
    watched.worker.start()
    try:
        with pytest.raises(WorkerError, match="method 'guess' is unknown"):
            watched.run(burst(0), burst(1), burst(2), burst(3))
        assert watched.worker.counts.restarts == 0
    finally:
        watched.worker.close()


def test_live_the_oldest_burst_goes_when_the_queue_is_full() -> None:
    watched = Watched(lossless=False)  # not started: nothing leaves the queue
    for number in range(5):
        watched.worker.submit(burst(number))
    assert [b.id for b in watched.worker._queue] == [3, 4]
    assert watched.worker.counts.dropped == 3
    assert watched.worker.waiting == 2


def test_a_torn_kernel_on_disk_stops_neither_the_worker_nor_fuse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    serving._warm_up(SETTINGS)  # compiled, should they not be
    copied = []
    for cache in caches():
        folder = UserProvidedCacheLocator.get_suitable_cache_subpath(inspect.getfile(cache._py_func))
        for path in cache.files[-1].folder.glob(f"{cache._impl.filename_base}.*"):
            (tmp_path / folder).mkdir(exist_ok=True, mode=0o755)
            copied.append(Path(shutil.copy(path, tmp_path / folder / path.name)))
    (torn,) = (path for path in copied if path.name.startswith("noise.thinned-") and path.suffix == ".nbi")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    config = tmp_path / "rig.toml"
    config.write_text("[fusion]\nregister_poses = false\n")  # few kernels are needed
    command = [sys.executable, "-m", "lidarboost", "fuse", WEDGES, "--method", "nearest", "--config", config]
    torn.write_bytes(b"")
    done = subprocess.run(command, capture_output=True, text=True, cwd=WEDGES.parents[1])
    assert (done.returncode, done.stderr) == (0, "")
    assert torn.stat().st_size > 0
    torn.write_bytes(b"")
    watched = Watched()
    watched.worker.start()
    try:
        watched.run(burst(0))
    finally:
        watched.worker.close()
    assert [r.report.burst for r in watched.fused] == [0]
    assert watched.worker.counts.restarts == 0
    assert torn.stat().st_size > 0


@pytest.mark.parametrize("after", [0.0, 0.3])
def test_closing_never_hangs_and_leaves_no_process(after: float) -> None:
    watched = Watched(lossless=False)
    watched.worker.start()
    watched.worker.submit(burst(0))
    time.sleep(after)
    began = time.monotonic()
    watched.worker.close()
    assert time.monotonic() - began < 8
    assert not watched.worker._thread.is_alive()
    assert watched.worker._process._process is None
    with pytest.raises(WorkerError, match="closed"):
        watched.worker.submit(burst(1))
