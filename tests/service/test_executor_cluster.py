"""Bursts fused by a real Dask cluster whose parts go away, and come back."""

import os
import signal
import socket
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import pytest
from dask_cluster import DaskCluster, dask_cluster, until
from gated import gated, waiting
from test_executor_contract import HERE, NEAREST, begun, job, map_of

from service.config.sections import Configuration, FusionSection
from service.errors import ConfigurationError
from service.fusion import cluster as cluster_module
from service.fusion.configured import configured_executor
from service.fusion.executor import Executor
from service.messages.map import FusedMap
from service.messages.status import ClusterState

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "_RETRY", 0.2)
    monkeypatch.setattr(cluster_module, "_LOOK", 0.2)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    with dask_cluster(tmp_path / "dask", 2, HERE) as found:
        yield found


def settings_of(cluster: DaskCluster) -> FusionSection:
    return FusionSection(**NEAREST, executor="cluster", cluster=cluster.address)


def told(executor: Executor) -> ClusterState:
    state = executor.state.cluster
    assert state is not None
    return state


def workers_at(gate: Path, *numbers: int) -> list[int]:
    """Who fuses these bursts, once each has begun somewhere."""
    until(lambda: all(waiting(gate, number) for number in numbers))
    return [waiting(gate, number)[0] for number in numbers]


def submitted(
    executor: Executor, gate: Path, settings: FusionSection, count: int
) -> "list[Future[FusedMap]]":
    gate.mkdir(exist_ok=True)
    return [executor.submit(gated(number, gate, settings)) for number in range(count)]


def all_fused(futures: "list[Future[FusedMap]]", gate: Path) -> None:
    (gate / "open").touch()
    assert [map_of(future).report.burst for future in futures] == list(range(len(futures)))


def test_bursts_are_fused_on_as_many_workers_as_there_are(cluster: DaskCluster, tmp_path: Path) -> None:
    settings, gate = settings_of(cluster), tmp_path / "gate"
    with begun(settings) as executor:
        futures = submitted(executor, gate, settings, 4)
        assert set(workers_at(gate, 0, 1)) == {process.pid for process in cluster.processes[1:]}
        assert not waiting(gate, 2)
        all_fused(futures, gate)
        assert (told(executor).fused, told(executor).returned, told(executor).workers) == (4, 0, 2)


def test_a_killed_workers_burst_is_fused_by_another(cluster: DaskCluster, tmp_path: Path) -> None:
    settings, gate = settings_of(cluster), tmp_path / "gate"
    with begun(settings) as executor:
        futures = submitted(executor, gate, settings, 3)
        (victim, other) = workers_at(gate, 0, 1)
        os.kill(victim, signal.SIGKILL)
        all_fused(futures, gate)
        until(lambda: other in waiting(gate, 0))
        assert told(executor).returned == 0
        assert executor.state.executor == "cluster"


def test_where_every_worker_is_killed_its_bursts_are_fused_here_until_there_is_one_again(
    cluster: DaskCluster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings, gate = settings_of(cluster), tmp_path / "gate"
    with begun(settings) as executor:
        futures = submitted(executor, gate, settings, 4)
        for pid in workers_at(gate, 0, 1):
            os.kill(pid, signal.SIGKILL)
        all_fused(futures, gate)
        assert executor.state.executor == "local"
        assert told(executor).returned == 2
        assert "no workers" in str(told(executor).error)
        assert "bursts are fused on this machine meanwhile" in caplog.text
        cluster.start_worker(HERE)
        until(lambda: executor.state.executor == "cluster")
        before = told(executor).fused
        assert map_of(executor.submit(job(9, settings))).report.burst == 9
        assert (told(executor).fused, told(executor).error, told(executor).workers) == (before + 1, None, 1)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_that_goes_away_costs_no_burst_and_is_used_again_once_it_is_back(
    cluster: DaskCluster, tmp_path: Path, how: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.fusion.link._LIMIT", 3.0)
    settings, gate = settings_of(cluster), tmp_path / "gate"
    with begun(settings) as executor:
        futures = submitted(executor, gate, settings, 4)
        workers_at(gate, 0, 1)
        os.kill(cluster.scheduler.pid, how)
        until(lambda: executor.state.executor == "local")
        all_fused(futures, gate)
        until(lambda: told(executor).error is not None)
        assert cluster.address in str(told(executor).error)
        assert map_of(executor.submit(job(7, settings))).report.burst == 7
        for process in cluster.processes:
            process.kill()
            process.wait()
        cluster.start_scheduler()
        cluster.start_worker(HERE)
        until(lambda: executor.state.executor == "cluster")
        before = told(executor).fused
        assert map_of(executor.submit(job(8, settings))).report.burst == 8
        assert told(executor).fused == before + 1


def test_a_worker_that_hangs_costs_no_burst(
    cluster: DaskCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_module, "_FLOOR", 2.0)
    settings, gate = settings_of(cluster), tmp_path / "gate"
    with begun(settings) as executor:
        for number in range(4):  # what is usual
            map_of(executor.submit(job(number, settings)))
        futures = submitted(executor, gate, settings, 1)
        (pid,) = workers_at(gate, 0)
        os.kill(pid, signal.SIGSTOP)
        all_fused(futures, gate)
        assert told(executor).returned == 1


def test_a_worker_of_another_version_is_told_and_given_nothing(cluster: DaskCluster, tmp_path: Path) -> None:
    old = tmp_path / "old" / "lidarboost-0.0.1.dist-info"
    old.mkdir(parents=True)
    (old / "METADATA").write_text("Metadata-Version: 2.1\nName: lidarboost\nVersion: 0.0.1\n")
    settings = settings_of(cluster)
    with begun(settings) as executor:
        for process in cluster.processes[1:]:
            process.kill()
        cluster.start_worker(tmp_path / "old")
        until(lambda: "has lidarboost 0.0.1" in str(told(executor).error))
        assert "install the same version on every worker" in str(told(executor).error)
        assert map_of(executor.submit(job(1, settings))).report.burst == 1
        assert executor.state.executor == "local"


def test_a_scheduler_that_never_answers_costs_nothing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        settings = FusionSection(**NEAREST, executor="cluster", cluster=address)
        with configured_executor(Configuration(fusion=settings)) as executor:
            assert map_of(executor.submit(job(0, settings))).report.burst == 0
            until(lambda: told(executor).error is not None)
            assert address in str(told(executor).error)
            assert executor.state.executor == "local"


def test_a_library_that_is_not_there_is_told_with_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("service.versions.find_spec", lambda _: None)
    settings = FusionSection(executor="cluster", cluster="tcp://127.0.0.1:8786")
    with pytest.raises(ConfigurationError, match=r"pip install 'lidarboost\[cluster\]'"):
        configured_executor(Configuration(fusion=settings))
