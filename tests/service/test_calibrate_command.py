import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rendered import Studio
from typer.testing import CliRunner

from drivers.calibration import Calibration, sr3000_calibration
from drivers.recording import RecordingWriter
from drivers.simulation.scene import plate
from drivers.simulation.scenes import SCENES
from service.cli import app

CAMERA = sr3000_calibration()


def run(*arguments):
    return CliRunner().invoke(app, ["calibrate", *map(str, arguments)])


def record(path, frames):
    with RecordingWriter(path) as writer:
        writer.write_calibration(CAMERA, frames[0].timestamp)
        for number, frame in enumerate(frames):
            numbered = replace(frame, sequence=number, timestamp=10**9 + number * 10**8)
            writer.write_frame(numbered, CAMERA.mount, numbered.timestamp)
    return path


@pytest.fixture(scope="module")
def objects():
    studio = Studio(SCENES["objects"](), CAMERA)
    return [studio.frame() for _ in range(4)]


def board_frame(blank, rotation, place):
    """A frame whose amplitude shows a board of 9 × 6 corners, fields of 50 mm, drawn in perspective."""
    dots = 40  # per field
    fields = (np.add.outer(np.arange(9), np.arange(12)) % 2) * 3000.0 + 600.0
    fields[0], fields[-1], fields[:, 0], fields[:, -1] = 3600.0, 3600.0, 3600.0, 3600.0
    drawn = np.kron(fields, np.ones((dots, dots)))
    R = cv2.Rodrigues(np.radians(np.array(rotation, dtype=float)))[0]
    to_board = np.array([[0.05 / dots, 0, -0.3], [0, 0.05 / dots, -0.225], [0, 0, 1]])
    fine = np.array([[4.0, 0, 1.5], [0, 4.0, 1.5], [0, 0, 1]]) @ CAMERA.intrinsics.matrix
    plane = fine @ np.column_stack([R[:, 0], R[:, 1], place]) @ to_board
    seen = cv2.warpPerspective(drawn, plane, (4 * 176, 4 * 144), flags=cv2.INTER_AREA, borderValue=900.0)
    amplitude = cv2.resize(seen, (176, 144), interpolation=cv2.INTER_AREA)
    return replace(blank, amplitude=amplitude.astype(np.uint16))


VIEWS = [
    ((0, 0, 0), (0.0, 0.0, 0.85)),
    ((0, 30, 0), (0.02, 0.05, 0.80)),
    ((0, -30, 5), (0.0, -0.05, 0.85)),
    ((30, 0, 0), (-0.10, 0.02, 0.85)),
    ((-30, 0, -5), (0.10, 0.0, 0.85)),
    ((20, 20, 10), (-0.15, -0.10, 1.00)),
    ((20, -20, -10), (0.15, -0.12, 1.00)),
    ((-20, 20, 0), (-0.16, 0.13, 1.00)),
    ((-20, -20, 0), (0.18, 0.13, 1.00)),
]


def test_intrinsics_from_a_recording(tmp_path, objects):
    path = record(tmp_path / "board.mcap", [board_frame(objects[0], *view) for view in VIEWS])
    output = tmp_path / "calibration.toml"
    done = run("intrinsics", path, "--board", "9x6", "--square", "50", "-o", output)
    assert done.exit_code == 0, done.stderr
    found = Calibration.load(output)
    assert found.intrinsics.fx == pytest.approx(200.0, rel=0.01)
    assert found.intrinsics.cx == pytest.approx(87.5, abs=2.0)
    assert found.source == "nominal SR3000 optics; intrinsics calibrated"
    assert cv2.imread(str(tmp_path / "calibration.intrinsics.png")) is not None
    assert "reprojection error" in done.stdout


def test_too_few_views_end_with_one_line(tmp_path, objects):
    path = record(tmp_path / "board.mcap", [board_frame(objects[0], *VIEWS[0])] * 2)
    done = run("intrinsics", path, "-o", tmp_path / "calibration.toml")
    assert done.exit_code == 1
    assert "1 different views of the board, at least 8 are needed" in done.stderr
    assert not (tmp_path / "calibration.toml").exists()


def test_noise_then_distance_build_on_one_file(tmp_path, objects):
    output = tmp_path / "calibration.toml"
    still = record(tmp_path / "still.mcap", objects)
    assert run("noise", still, "-o", output).exit_code == 0
    studio = Studio([plate((0, 0, 2.0), 20, 20, 0.6)], CAMERA)
    wall = record(tmp_path / "wall.mcap", [studio.frame() for _ in range(3)])
    done = run("distance", wall, "--at", "1.95", "--base", output, "-o", output, "--json")
    assert done.exit_code == 0, done.stderr
    said = json.loads(done.stdout)
    # 50 mm ahead, 5 % more on average over the view.
    assert said["calibration"]["corrections"]["constant"] == pytest.approx(0.0525, abs=0.001)
    found = Calibration.load(output)
    assert found.noise is not None
    assert found.noise.coefficient == pytest.approx(30.0, rel=0.05)
    assert found.source == "nominal SR3000 optics; noise calibrated; distance calibrated"
    for part in ("noise", "distance"):
        assert (tmp_path / f"calibration.{part}.png").stat().st_size > 10_000


def test_live_camera(tmp_path, objects):
    config = tmp_path / "rig.toml"
    still = record(tmp_path / "still.mcap", objects)
    config.write_text(f'[camera]\nbackend = "replay"\noptions = {{ path = "{still}" }}\n')
    done = run("noise", "-c", config, "-n", "50", "-o", tmp_path / "calibration.toml")
    assert done.exit_code == 0, done.stderr
    assert "from 4 frames" in done.stdout


def test_live_mount_turns_the_stage(tmp_path):
    config = tmp_path / "rig.toml"
    config.write_text(
        """
[camera]
backend = "simulated"
options = { scene = "board", mount_rotation = [0.02, 0.0, 0.03] }
settings = { integration_time = 0.01 }
[stage]
backend = "simulated"
settle = 0.0
"""
    )
    output = tmp_path / "calibration.toml"
    done = run("mount", "-c", config, "--tilt", "0", "--repeats", "1", "-o", output)
    assert done.exit_code == 0, done.stderr
    found = Calibration.load(output).mount
    assert found.lever_arm == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert found.rotation == pytest.approx((0.02, 0.0, 0.03), abs=0.005)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("noise",), "give recordings, or a camera by --config"),
        (("intrinsics", "--board", "9by6"), "expected inner corners"),
        (("intrinsics", "--charuco", "DICT_4X4_50"), "--marker"),
    ],
)
def test_wrong_usage(tmp_path, arguments, said):
    done = run(*arguments, "-o", tmp_path / "calibration.toml")
    assert done.exit_code == 2
    assert said in done.stderr


def test_file_that_exists_is_kept(tmp_path):
    output = tmp_path / "calibration.toml"
    output.write_text("mine")
    done = run("noise", "-o", output)
    assert done.exit_code == 1
    assert "exists already" in done.stderr
    assert output.read_text() == "mine"
