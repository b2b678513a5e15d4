"""`lidarboost run`, `fuse` and `config` as they are typed: results, exit statuses, one line per error."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scripted import calibration, frame
from typer.testing import CliRunner, Result

from drivers import Frame
from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording
from service.cli import COMMANDS, app
from service.wire.session import open_session

ROOT = Path(__file__).parents[2]
WEDGES = ROOT / "recordings" / "wedges.mcap"


@pytest.fixture(autouse=True)
def _settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, endpoint: str) -> None:
    """A port of its own, and the fastest method: what is tested here is not the fusion."""
    for name in os.environ:
        if name.startswith("LIDARBOOST_"):
            monkeypatch.delenv(name)
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    monkeypatch.setenv("LIDARBOOST_ZENOH__CONFIG", str(zenoh))
    monkeypatch.setenv("LIDARBOOST_FUSION__METHOD", "nearest")
    monkeypatch.setenv("LIDARBOOST_FUSION__REGISTER_POSES", "false")


def lidarboost(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words], prog_name="lidarboost")


def write(path: Path, frames: list[Frame], *, calibrated: bool = True) -> Path:
    with RecordingWriter(path) as writer:
        if calibrated:
            writer.write_calibration(calibration(), 0)
        for one in frames:
            writer.write_frame(one, Mount())
    return path


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Three bursts of four tiny frames."""
    frames = [frame(k, 10**18 + k * 10**8, burst=k // 4, pose=k % 4) for k in range(12)]
    return write(tmp_path / "small.mcap", frames)


def torn(source: Path, target: Path, part: float) -> Path:
    data = source.read_bytes()
    target.write_bytes(data[: int(part * len(data))])
    return target


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


def bad_text(path: Path) -> Path:
    path.write_text("not a recording at all")
    return path


def bad_empty(path: Path) -> Path:
    path.touch()
    return path


def bad_no_frames(path: Path) -> Path:
    return write(path, [])


def bad_size(path: Path) -> Path:
    wrong = np.full((5, 5), 20_000, np.uint16)
    return write(path, [frame(0, burst=0, pose=0, counts=wrong, amplitude=wrong)])


def bad_two_sizes(path: Path) -> Path:
    wrong = np.full((5, 5), 20_000, np.uint16)
    return write(path, [frame(0, burst=0), frame(1, burst=0, counts=wrong, amplitude=wrong)])


def bad_torn_head(path: Path) -> Path:
    return torn(WEDGES, path, 0.001)


def bad_calibration(path: Path) -> Path:
    return write(path, [frame(0, burst=0)], calibrated=False)


def bad_missing(path: Path) -> Path:
    return path


@pytest.mark.parametrize("command", ["run", "fuse"])
@pytest.mark.parametrize(
    ("make", "said"),
    [
        (bad_text, "not"),
        (bad_empty, "empty"),
        (bad_no_frames, "holds no whole frame"),
        (bad_size, "calibration is for 4 × 6"),
        (bad_two_sizes, "5 × 5 pixels"),
        (bad_torn_head, "torn"),
        (bad_calibration, "holds no calibration"),
        (bad_missing, "No such file"),
    ],
)
def test_a_bad_recording_is_one_clear_line_status_1_and_nothing_written(
    command: str, make: Callable[[Path], Path], said: str, tmp_path: Path
) -> None:
    path = make(tmp_path / "bad.mcap")
    words = ("run", "--replay", path, "--once") if command == "run" else ("fuse", path)
    result = lidarboost(*words, "--output", tmp_path / "out")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert str(path) in line
    assert said in line
    assert not (tmp_path / "out").exists()


def test_a_calibration_file_makes_up_for_a_missing_one(tmp_path: Path) -> None:
    path = bad_calibration(tmp_path / "bare.mcap")
    calibration().save(tmp_path / "camera.toml")
    config = tmp_path / "rig.toml"
    config.write_text(f'[camera]\ncalibration = "{tmp_path / "camera.toml"}"\n')
    assert lidarboost("run", config, "--replay", path, "--once").exit_code == 0
    assert lidarboost("fuse", path, "--config", config).exit_code == 0


def test_an_unknown_key_is_status_2(tmp_path: Path, small: Path) -> None:
    config = tmp_path / "rig.toml"
    config.write_text('[fusion]\nmetod = "area"\n')
    for words in (("run", config, "--replay", small, "--once"), ("config", "check", config)):
        result = lidarboost(*words)
        assert result.exit_code == 2
        (line,) = result.stderr.splitlines()
        assert line == f"error: {config}: unknown key fusion.metod; did you mean fusion.method?"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[camera]\nbackend = "simulatd"', "camera.backend = 'simulatd'"),
        ('[camera]\nbackend = "simulated"\n[camera.options]\nscen = "plane"', "camera.options"),
        ('[stage]\nbackend = "simulated"\n[stage.options]\nspeeed = 1', "stage.options"),
        ('[camera]\ncalibration = "nowhere.toml"', "camera.calibration: nowhere.toml"),
        ('[sinks.x]\nkind = "nowhere"', "sinks.x.kind = 'nowhere'"),
        ('[sinks.x]\nkind = "service.sinks.summaries:Summaries"\noptions.a = 1', "sinks.x.options: a"),
    ],
)
def test_the_options_of_backends_are_checked_too(tmp_path: Path, text: str, said: str) -> None:
    config = tmp_path / "rig.toml"
    config.write_text(text)
    result = lidarboost("config", "check", config)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert said in line


def test_config_check_shows_what_is_in_force_and_schema_is_json() -> None:
    result = lidarboost("config", "check", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["fusion"]["method"] == "nearest"
    assert "fusion" in json.loads(lidarboost("config", "schema").stdout)["properties"]


def test_a_port_in_use_is_one_line_and_status_1(small: Path, endpoint: str, tmp_path: Path) -> None:
    with open_session(listen=[endpoint]):
        result = lidarboost("run", "--replay", small, "--once", "--output", tmp_path / "out")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert endpoint in line
    assert "in use by" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("run", "--speed", "2"),
        ("run", "--loop"),
        ("run", "--replay", "x", "--once", "--loop"),
        ("run", "--nonsense"),
        ("nonsense",),
        ("fuse",),
        ("fuse", "a", "b", "-o", "c"),
        ("fuse", "a", "-o", "c", "--output", "d"),
        ("fuse", "a", "-o", "a"),
        ("fuse", "a", "--method", "guess"),
        ("fuse", "a", "--regularization", "-1"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(words: tuple[str, ...]) -> None:
    result = lidarboost(*words)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")


def test_fuse_writes_the_same_maps_each_time(small: Path, tmp_path: Path) -> None:
    result = lidarboost("fuse", small, "--output", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.stderr
    (found,) = json.loads(result.stdout)
    assert [b["report"]["burst"] for b in found["bursts"]] == [0, 1, 2]
    fused = Path(found["output"])
    stem = fused.name.removesuffix("-fused.mcap")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [f"{stem}-burst-000{k}.png" for k in range(3)] + [fused.name]
    assert lidarboost("fuse", small, "-o", tmp_path / "again.mcap").exit_code == 0
    first, again = (
        [(m.topic, m.payload, at) for m, at in open_recording(path).messages() if m.topic != "fused/report"]
        for path in (fused, tmp_path / "again.mcap")
    )
    assert first == again


def test_fuse_goes_on_with_the_next_input_and_fails_in_the_end(small: Path, tmp_path: Path) -> None:
    result = lidarboost("fuse", bad_text(tmp_path / "bad.mcap"), small)
    assert result.exit_code == 1
    assert "small.mcap: burst 2" in result.stdout
    assert result.stderr.startswith("error: ")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_that_teaches(name: str) -> None:
    result = lidarboost(name, "--help")
    assert result.exit_code == 0
    assert "Usage: lidarboost" in result.stdout


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from service.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'cv2', 'zenoh', 'matplotlib', 'pydantic'} & sys.modules.keys()\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    for name in COMMANDS:
        assert name in done.stdout


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
