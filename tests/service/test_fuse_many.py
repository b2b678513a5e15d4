"""`lidarboost fuse` with many files and folders: a pool, and results named by content, not made twice."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from dask_cluster import ROOT, until
from scripted import calibration, frame
from typed import lidarboost

from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording
from service.config.sections import FusionSection
from service.jobs.pool import fuse_in_pool
from service.jobs.result_name import recordings_among, result_path, working_file
from service.jobs.task import FuseTask
from service.messages.viewing import Extras

WEDGES = ROOT / "recordings" / "wedges.mcap"


pytestmark = pytest.mark.usefixtures("typing_settings")


def tiny(path: Path, first: int = 0) -> Path:
    """Two bursts of four tiny frames."""
    path.parent.mkdir(exist_ok=True)
    with RecordingWriter(path) as writer:
        writer.write_calibration(calibration(), 0)
        for k in range(first, first + 8):
            writer.write_frame(frame(k, 10**18 + k * 10**8, burst=k // 4, pose=k % 4), Mount())
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_is_there_is_not_done_again_but_what_differs_or_is_torn_is(tmp_path: Path) -> None:
    path, output = tiny(tmp_path / "scan.mcap"), tmp_path / "out"
    first = json.loads(lidarboost("fuse", path, "--output", output, "--json").stdout)[0]
    target, before = Path(first["output"]), names(output)
    stamp = target.stat().st_mtime_ns
    again = json.loads(lidarboost("fuse", path, "--output", output, "--json").stdout)[0]
    assert again == first | {"resumed": True}
    assert (names(output), target.stat().st_mtime_ns) == (before, stamp)
    target.write_bytes(target.read_bytes()[:-500])
    mended = json.loads(lidarboost("fuse", path, "--output", output, "--json").stdout)[0]
    assert (mended["resumed"], open_recording(target).damage) == (False, None)
    assert names(output) == before
    other = json.loads(lidarboost("fuse", path, "--output", output, "--upsampling", 2, "--json").stdout)[0]
    assert other["output"] != first["output"]
    tiny(path, 4)
    changed = json.loads(lidarboost("fuse", path, "--output", output, "--json").stdout)[0]
    assert len({Path(one["output"]) for one in (first, other, changed)}) == 3


def test_a_name_depends_on_what_decides_the_maps_alone(tmp_path: Path) -> None:
    path, settings, known = tiny(tmp_path / "scan.mcap"), FusionSection(), tmp_path / "camera.toml"
    calibration().save(known)

    def name(**changed: object) -> str:
        given = {"fusion": settings, "extras": Extras(), "calibration": None} | changed
        return result_path(path, tmp_path, **given).name

    same = {"timeout": 5.0, "backlog": 7}
    assert name() == name(fusion=settings.model_copy(update=same))
    wider = settings.model_copy(update={"fill": 2.0})
    different = [name(), name(fusion=wider), name(extras=Extras(points=2)), name(calibration=known)]
    assert len(set(different)) == 4
    path.rename(tmp_path / "moved.mcap")
    moved = result_path(tmp_path / "moved.mcap", tmp_path, settings, Extras()).name
    assert moved == different[0].replace("scan", "moved")


@pytest.mark.slow
def test_folders_give_their_recordings_but_no_results(tmp_path: Path) -> None:
    path = tiny(tmp_path / "in" / "scan.mcap")
    (tmp_path / "in" / "deep").mkdir()
    deep = tiny(tmp_path / "in" / "deep" / "other.mcap", 4)
    result = lidarboost("fuse", path.parent, path, "--output", path.parent)
    assert result.exit_code == 0, result.stderr
    assert result.stderr.splitlines()[-1] == "2 recordings: 2 fused"
    assert recordings_among([path.parent]) == [deep, path]
    (tmp_path / "empty").mkdir()
    refused = lidarboost("fuse", tmp_path / "empty")
    assert (refused.exit_code, "holds no recording" in refused.stderr) == (1, True)
    assert lidarboost("fuse", path.parent, "-o", tmp_path / "x.mcap").exit_code == 2
    assert lidarboost("fuse", path, "--workers", 1, "--cluster", "a:1").exit_code == 2


@pytest.mark.slow
def test_a_failure_or_damage_does_not_stop_the_rest(tmp_path: Path) -> None:
    good = tiny(tmp_path / "good.mcap")
    torn = tmp_path / "torn.mcap"
    shutil.copy(WEDGES, torn)
    torn.write_bytes(torn.read_bytes()[: torn.stat().st_size // 2])
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    result = lidarboost("fuse", text, torn, good, "--output", tmp_path / "out", "--json")
    assert result.exit_code == 1
    bad, damaged, whole = json.loads(result.stdout)
    assert str(text) in bad["error"]
    assert (damaged["error"], "torn" in damaged["damage"], len(damaged["bursts"])) == (None, True, 1)
    assert (whole["error"], whole["damage"], len(whole["bursts"])) == (None, None, 2)
    assert lidarboost("fuse", torn, good, "--output", tmp_path / "out").exit_code == 3
    nothing = lidarboost("fuse", text, tmp_path / "nowhere.mcap", "--output", tmp_path / "none")
    assert (nothing.exit_code, (tmp_path / "none").exists()) == (1, False)


def test_what_a_dead_process_left_behind_goes_and_what_is_being_written_stays(tmp_path: Path) -> None:
    target = tmp_path / "scan-0123456789ab-fused.mcap"
    (tmp_path / "scan-0123456789ab-fused.00000000.partial.mcap.active").write_bytes(b"torn")
    with working_file(target) as one, RecordingWriter(one) as writer:
        assert names(tmp_path) == [writer.working_path.name]
        with working_file(target) as two, RecordingWriter(two):
            assert len(names(tmp_path)) == 2
        assert target.exists()
    assert names(tmp_path) == [target.name]


def test_without_the_library_one_line_tells_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = lidarboost("fuse", WEDGES, "--cluster", "127.0.0.1:8786")
    (line,) = result.stderr.splitlines()
    assert (result.exit_code, "pip install 'lidarboost[cluster]'" in line) == (1, True)


@pytest.mark.slow
def test_a_killed_process_is_replaced_and_its_recording_done(tmp_path: Path) -> None:
    paths = [tmp_path / f"scan{k}.mcap" for k in range(4)]
    for path in paths:
        shutil.copy(WEDGES, path)
    output = tmp_path / "out"
    command = [sys.executable, "-m", "lidarboost", "fuse", *paths, "--output", output, "--workers", "2"]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    until(lambda: any(output.glob("*.active")))
    threads = Path(f"/proc/{process.pid}/task").iterdir()
    pids = [int(pid) for task in threads for pid in (task / "children").read_text().split()]
    assert len(pids) == 2
    os.kill(pids[0], 9)
    _, errors = process.communicate(timeout=150)
    assert (process.returncode, errors) == (0, "4 recordings: 4 fused\n")
    assert len(list(output.glob("*-fused.mcap"))) == 4
    assert list(output.glob("*.partial*")) == []


@pytest.mark.slow
def test_a_recording_over_which_processes_die_fails_and_the_others_do_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hook = tmp_path / "sitecustomize.py"  # read by each process of the pool as it starts
    hook.write_text(
        "import os, pathlib\nopened = pathlib.Path.open\n"
        "def deadly(path, *words, **more):\n"
        "    if path.name == 'deadly.mcap':\n        os.kill(os.getpid(), 9)\n"
        "    return opened(path, *words, **more)\n"
        "pathlib.Path.open = deadly\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    settings = FusionSection(method="nearest", register_poses=False)
    recordings = [tiny(tmp_path / name) for name in ("deadly.mcap", "good.mcap")]
    tasks = [FuseTask(path, settings, directory=tmp_path / "out") for path in recordings]
    done = {Path(result.input).name: result for result in fuse_in_pool(tasks, 1)}
    assert "the fusion process died (signal 9)" in str(done["deadly.mcap"].error)
    assert done["good.mcap"].error is None
