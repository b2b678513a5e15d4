"""`lidarboost run` as it is typed: what is fused, published, written and said."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from scripted import calibration, frame
from typed import lidarboost, torn

from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording
from service.wire.session import open_session

ROOT = Path(__file__).parents[2]
WEDGES = ROOT / "recordings" / "wedges.mcap"

pytestmark = pytest.mark.usefixtures("typing_settings")


def test_the_bundled_recording_is_fused_published_and_written(tmp_path: Path) -> None:
    result = lidarboost("run", "--replay", WEDGES, "--once", "--output", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.stderr
    summary = json.loads(result.stdout)
    (burst,) = summary["fused"]
    assert (summary["frames"], summary["maps"], summary["lost"]) == (15, 1, [])
    assert (burst["report"]["width"], burst["report"]["height"]) == (704, 576)
    # `nearest` is one frame: the two figures are the same, but for pixels too dark to use.
    assert burst["errors"]["rms"] == pytest.approx(burst["errors"]["nearest_rms"], rel=0.03)
    assert 0.1 < burst["errors"]["rms"] < 0.2
    assert open_recording(tmp_path / "out" / "fused.mcap").truth is not None
    assert (tmp_path / "out" / "burst-0000.png").stat().st_size > 100_000


def test_what_was_done_is_said_with_units(small: Path) -> None:
    result = lidarboost("run", "--replay", small, "--once")
    assert result.exit_code == 0, result.stderr
    assert "12 frames of recording small.mcap (replay), 3 bursts, 3 maps" in result.stdout
    assert result.stderr.count("burst 2: 4 of 4 frames; 24 × 16 pixels; nearest; median deviation") == 1


def test_what_was_imported_is_left_out_of_collections_before_the_first_frame(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from drivers.replay import ReplayCamera

    done: list[str] = []
    grab = ReplayCamera.grab
    monkeypatch.setattr("gc.freeze", lambda: done.append("freeze"))
    monkeypatch.setattr(
        ReplayCamera, "grab", lambda self, timeout: (done.append("grab"), grab(self, timeout))[1]
    )
    assert lidarboost("run", "--replay", small, "--once").exit_code == 0
    assert done[:2] == ["freeze", "grab"]
    assert done.count("freeze") == 1


def test_a_torn_recording_is_fused_as_far_as_it_goes_and_the_loss_is_told(tmp_path: Path) -> None:
    frames = [frame(k, 10**18 + k * 10**8, burst=k // 4, pose=k % 4) for k in range(12)]
    whole = tmp_path / "whole.mcap"
    with RecordingWriter(whole) as writer:
        writer.write_calibration(calibration(), 0)
        for one in frames:
            writer.write_frame(one, Mount())
            writer.flush()
    path = torn(whole, tmp_path / "torn.mcap", 0.5)
    result = lidarboost("run", "--replay", path, "--once", "--output", tmp_path / "out")
    assert result.exit_code == 3
    (loss,) = [line for line in result.stderr.splitlines() if line.startswith("lost:")]
    assert "torn at byte" in loss
    assert (tmp_path / "out" / "fused.mcap").exists()
    assert lidarboost("fuse", path).exit_code == 3


def test_a_port_in_use_is_one_line_and_status_1(small: Path, endpoint: str, tmp_path: Path) -> None:
    with open_session(listen=[endpoint]):
        result = lidarboost("run", "--replay", small, "--once", "--output", tmp_path / "out")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert endpoint in line
    assert "in use by" in line
    assert not (tmp_path / "out").exists()


def test_a_running_service_ends_cleanly_on_sigterm(small: Path) -> None:
    code = "from service.cli import main; main()"
    words = ["run", "--replay", str(small), "--loop", "--speed", "5"]
    service = subprocess.Popen(
        [sys.executable, "-u", "-c", code, *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    said = []
    assert service.stdout is not None
    for line in service.stdout:
        said.append(line)
        if ": 4 of 4 frames" in line:
            service.send_signal(signal.SIGTERM)
            service.send_signal(signal.SIGTERM)  # as `timeout` does
            break
    rest, _ = service.communicate(timeout=60)
    assert service.returncode == 0, "".join(said) + rest
    assert " maps, " in rest
