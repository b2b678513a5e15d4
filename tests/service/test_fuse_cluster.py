"""`lidarboost fuse --cluster` with a real Dask scheduler and workers, some of which are lost."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from dask_cluster import ROOT, DaskCluster, dask_cluster, until

from drivers.recording import open_recording

pytestmark = pytest.mark.slow

WEDGES = ROOT / "recordings" / "wedges.mcap"
RUN = (sys.executable, "-m", "lidarboost", "fuse")


@pytest.fixture(autouse=True)
def _settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fastest method: what is tested here is not the fusion."""
    monkeypatch.setenv("LIDARBOOST_FUSION__METHOD", "nearest")
    monkeypatch.setenv("LIDARBOOST_FUSION__REGISTER_POSES", "false")


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    with dask_cluster(tmp_path / "dask", 2) as found:
        yield found


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    """Six recordings in a folder, the fourth torn, and one that is none."""
    folder = tmp_path / "scans"
    folder.mkdir()
    for number in range(6):
        shutil.copy(WEDGES, folder / f"scan{number}.mcap")
    data = WEDGES.read_bytes()
    (folder / "scan3.mcap").write_bytes(data[: len(data) // 2])
    (folder / "text.mcap").write_text("not a recording at all")
    return folder


def begun(*words: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*RUN, *map(str, words)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ended(process: "subprocess.Popen[str]") -> tuple[int, str, str]:
    said, errors = process.communicate(timeout=150)
    return process.returncode, said, errors


def maps(folder: Path) -> dict[str, list[tuple[str, bytes]]]:
    return {
        path.name: [(m.topic, m.payload) for m, _ in open_recording(path).messages(["fused/depth"])]
        for path in folder.glob("*-fused.mcap")
    }


def left_over(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if ".partial" in path.name]


def test_a_cluster_gives_what_the_pool_gives_and_goes_on_past_bad_files(
    cluster: DaskCluster, scans: Path, tmp_path: Path
) -> None:
    status, said, errors = ended(
        begun(scans, "--output", tmp_path / "a", "--cluster", cluster.address, "--json")
    )
    assert status == 1, errors
    found = {Path(one["input"]).name: one for one in json.loads(said)}
    assert "not" in found["text.mcap"]["error"]
    assert "torn" in found["scan3.mcap"]["damage"]
    assert [one["error"] for name, one in found.items() if name != "text.mcap"] == [None] * 6
    assert errors.splitlines()[-1] == "7 recordings: 6 fused, 1 damaged, 1 failed"
    status, _, errors = ended(begun(scans, "--output", tmp_path / "b"))
    assert status == 1, errors
    assert len(maps(tmp_path / "a")) == 6
    assert maps(tmp_path / "a") == maps(tmp_path / "b")


def test_a_killed_workers_recording_is_done_by_another(
    cluster: DaskCluster, scans: Path, tmp_path: Path
) -> None:
    (scans / "text.mcap").unlink()
    output = tmp_path / "out"
    process = begun(scans, "--output", output, "--cluster", cluster.address)
    until(lambda: any(output.glob("*.active")))
    cluster.processes[1].kill()
    status, _, errors = ended(process)
    assert status == 3, errors
    assert errors.splitlines()[-1] == "6 recordings: 6 fused, 1 damaged"
    assert len(maps(output)) == 6
    assert left_over(output) == []


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_where_the_scheduler_goes_away_the_same_command_goes_on_later(
    cluster: DaskCluster, scans: Path, tmp_path: Path, how: signal.Signals
) -> None:
    (scans / "text.mcap").unlink()
    output = tmp_path / "out"
    process = begun(scans, "--output", output, "--cluster", cluster.address, "--json")
    until(lambda: any(output.glob("*-fused.mcap")))
    os.kill(cluster.scheduler.pid, how)
    status, said, errors = ended(process)
    assert status == 1
    assert "Traceback" not in errors, errors
    (line,) = [line for line in errors.splitlines() if line.startswith("error:")]
    assert cluster.address in line
    assert "the same command goes on from there" in line
    assert len(json.loads(said)) == 6
    for worker in cluster.processes[1:]:
        worker.kill()
        worker.wait()
    there = len(maps(output))
    assert there >= 1
    status, _, errors = ended(begun(scans, "--output", output))
    assert status == 3, errors
    assert f"{6 - there} fused, {there} fused before" in errors
    assert len(maps(output)) == 6
    assert left_over(output) == []


def test_another_version_on_a_worker_is_one_line(tmp_path: Path) -> None:
    old = tmp_path / "old" / "lidarboost-0.0.1.dist-info"
    old.mkdir(parents=True)
    (old / "METADATA").write_text("Metadata-Version: 2.1\nName: lidarboost\nVersion: 0.0.1\n")
    with dask_cluster(tmp_path / "dask", 1) as cluster:
        cluster.start_worker(tmp_path / "old")
        log = tmp_path / "dask" / "0.log"
        until(lambda: log.read_text().count("Register worker") == 2)
        status, _, errors = ended(begun(WEDGES, "--cluster", cluster.address))
    assert status == 1
    (line,) = errors.splitlines()
    assert "has lidarboost 0.0.1, this is" in line
    assert "install the same version on every worker" in line


def test_a_cluster_without_workers_is_one_line(tmp_path: Path) -> None:
    with dask_cluster(tmp_path / "dask", 0) as cluster:
        status, _, errors = ended(begun(WEDGES, "--cluster", cluster.address))
    (line,) = errors.splitlines()
    assert (status, "has no workers" in line) == (1, True)


def test_a_scheduler_that_never_answers_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        status, _, errors = ended(begun(WEDGES, "--cluster", address))
    (line,) = errors.splitlines()
    assert status == 1
    assert line.startswith(f"error: {address}: ")
    assert "is a Dask scheduler running there" in line
