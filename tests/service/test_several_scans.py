"""Two scans in one recording, and runs into one directory: nothing is mixed, nothing written over."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scripted import calibration, frame
from typed import lidarboost

from drivers.calibration import Calibration, Mount
from drivers.messages import decode_calibration
from drivers.recording import RecordingWriter, open_recording

HOUR = 3600 * 10**9
START = 10**18

pytestmark = pytest.mark.usefixtures("typing_settings", "_doubled")


@pytest.fixture
def _doubled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIDARBOOST_FUSION__UPSAMPLING", "2")


def wider() -> Calibration:
    """The same camera behind another lens."""
    known = calibration()
    optics = known.intrinsics.model_copy(
        update={"fx": known.intrinsics.fx / 2, "fy": known.intrinsics.fy / 2}
    )
    return known.model_copy(update={"intrinsics": optics})


@pytest.fixture
def merged(tmp_path: Path) -> Path:
    """A burst of four frames and, an hour later, one of three with the same id, through another lens."""
    path = tmp_path / "merged.mcap"
    with RecordingWriter(path) as writer:
        for scan, (count, known) in enumerate([(4, calibration()), (3, wider())]):
            begin = START + scan * HOUR
            writer.write_calibration(known, begin)
            for pose in range(count):
                one = frame(100 * scan + pose, begin + pose * 10**8, burst=0, pose=pose)
                writer.write_frame(one, Mount())
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def focal_lengths(path: Path) -> list[float]:
    messages = open_recording(path).messages(["fused/calibration"])
    return [decode_calibration(message.payload).K[0] for message, _ in messages]


def test_info_shows_two_bursts(merged: Path) -> None:
    said = json.loads(lidarboost("info", merged, "--json").stdout)
    assert [(b["burst"], b["frames"]) for b in said["frames"]["bursts"]] == [(0, 4), (0, 3)]


def test_fuse_and_run_cut_alike_and_use_each_scans_own_calibration(merged: Path, tmp_path: Path) -> None:
    fused = lidarboost("fuse", merged, "--output", tmp_path / "a", "--json")
    assert fused.exit_code == 0, fused.stderr
    run = lidarboost("run", "--replay", merged, "--once", "--output", tmp_path / "b", "--json")
    assert run.exit_code == 0, run.stderr
    (of_fuse,) = json.loads(fused.stdout)
    for bursts in (of_fuse["bursts"], json.loads(run.stdout)["fused"]):
        reports = [burst["report"] for burst in bursts]
        assert [report["sequence"] for report in reports] == [[0, 1, 2, 3], [100, 101, 102]]
        assert [report["missing"] for report in reports] == [0, 0]
    maps = Path(of_fuse["output"])
    stem = maps.name.removesuffix("-fused.mcap")
    assert names(tmp_path / "a") == [f"{stem}-burst-0000-2.png", f"{stem}-burst-0000.png", maps.name]
    assert names(tmp_path / "b") == ["burst-0000-2.png", "burst-0000.png", "fused.mcap"]
    expected = [2 * known.intrinsics.fx for known in (calibration(), wider())]
    for path in (maps, tmp_path / "b" / "fused.mcap"):
        assert focal_lengths(path) == expected
    again = open_recording(maps)
    assert [again.calibration_of(burst[0]) for burst in again.bursts(15)] == [calibration(), wider()]


def test_what_an_earlier_run_left_stays(merged: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    output.mkdir()
    left = [output / "fused.mcap", output / "fused-2.mcap", output / "burst-0000.png"]
    for path in left:
        path.write_bytes(b"precious")
    assert lidarboost("run", "--once", "--replay", merged, "--output", output).exit_code == 0
    assert all(path.read_bytes() == b"precious" for path in left)
    expected = ["fused-3.mcap", "burst-0000-2.png", "burst-0000-3.png"]
    assert names(output) == sorted([*(path.name for path in left), *expected])


def test_fuse_does_not_replace_a_file_unasked(merged: Path, tmp_path: Path) -> None:
    target = tmp_path / "fused.mcap"
    target.write_bytes(b"precious")
    refused = lidarboost("fuse", merged, "-o", target)
    assert (refused.exit_code, target.read_bytes()) == (1, b"precious")
    assert "exists already; choose another name, or replace it with --force" in refused.stderr
    assert lidarboost("fuse", merged, "-o", target, "--force").exit_code == 0
    assert len(focal_lengths(target)) == 2


def test_export_tells_bursts_of_one_id_apart(merged: Path, tmp_path: Path) -> None:
    assert lidarboost("export", merged, "-o", tmp_path / "x.npz").exit_code == 0
    with np.load(tmp_path / "x.npz") as arrays:
        assert arrays["burst"].tolist() == [0] * 7
        assert arrays["burst_index"].tolist() == [0] * 4 + [1] * 3
        assert "intrinsics" not in arrays
        assert arrays["burst_intrinsics"][:, 0, 0].tolist() == [
            known.intrinsics.fx for known in (calibration(), wider())
        ]
    assert lidarboost("export", merged, "-o", tmp_path / "x.ply", "--all").exit_code == 0
    assert len(list(tmp_path.glob("x-000*.ply"))) == 7


def test_export_of_frames_of_several_sizes(tmp_path: Path) -> None:
    path = tmp_path / "sizes.mcap"
    odd = np.full((5, 5), 20_000, np.uint16)
    with RecordingWriter(path) as writer:
        writer.write_calibration(calibration(), START)
        writer.write_frame(frame(0, START), Mount())
        writer.write_calibration(calibration().model_copy(update={"width": 5, "height": 5}), START + HOUR)
        writer.write_frame(replace(frame(1, START + HOUR), counts=odd, amplitude=odd), Mount())
    refused = lidarboost("export", path, "-o", tmp_path / "x.npz")
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1)
    assert "its frames have several sizes; export them as .ply" in refused.stderr
    assert lidarboost("export", path, "-o", tmp_path / "x.ply", "--all").exit_code == 0
    assert "of 5 × 5 pixels" in lidarboost("info", path).stdout


def test_the_truth_of_one_scan_judges_no_other(merged: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    found = open_recording(merged)
    np.savez(tmp_path / "truth.npz", distance=np.ones((8, 12), np.float32))
    with RecordingWriter(path) as writer:
        writer.attach("truth.npz", (tmp_path / "truth.npz").read_bytes(), "application/x-npz")
        writer.write_calibration(calibration(), START)
        for one in found.frames():
            writer.write_frame(one, Mount())
    assert open_recording(path).truth is None
    assert "it is not said which belongs to which of several scans" in lidarboost("info", path).stdout
