"""Recordings that cannot be fused: one clear line each, whatever the command."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scripted import calibration, frame
from typed import lidarboost, torn, write

WEDGES = Path(__file__).parents[2] / "recordings" / "wedges.mcap"

pytestmark = pytest.mark.usefixtures("typing_settings")


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
