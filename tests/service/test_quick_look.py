import json

import cv2
import pytest
from typer.testing import CliRunner

from drivers.recording import open_recording
from service.capture.frame_rate import frame_rate
from service.cli import app
from service.errors import ServiceError

SIMULATED = """
[camera]
backend = "simulated"
options = { scene = "plane" }
settings = { integration_time = 0.01 }
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(SIMULATED)
    return path


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_capture_writes_a_recording_and_a_picture(tmp_path, config):
    output = tmp_path / "look.mcap"
    done = run("capture", "-n", 4, "-o", output, "-c", config)
    assert done.exit_code == 0, done.stderr
    assert "4 frames of simulated SR3000" in done.stdout
    recording = open_recording(output)
    assert recording.frame_count == 4
    assert recording.calibration.source == "simulated SR3000"
    assert 'scene = "plane"' in recording.configuration
    assert cv2.imread(str(tmp_path / "look.png")) is not None
    assert run("capture", "-o", output, "-c", config).exit_code == 1


def test_capture_of_a_recording_ends_with_it(tmp_path, config):
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    assert run("capture", "-n", 3, "-o", first, "-c", config).exit_code == 0
    config.write_text(f'[camera]\nbackend = "replay"\noptions = {{ path = "{first}" }}\n')
    done = run("capture", "-n", 50, "-o", second, "-c", config, "--json")
    assert done.exit_code == 0, done.stderr
    said = json.loads(done.stdout)
    assert (said["frames"], said["dropped"]) == (3, 0)
    assert said["median_distance"] == pytest.approx(2.0, abs=0.1)


def test_hz_of_a_simulated_camera(config):
    done = run("hz", "-c", config, "--seconds", 0.6, "--json")
    said = json.loads(done.stdout)
    assert said["period"] == pytest.approx(41.0, abs=0.01)
    assert done.exit_code == (3 if said["dropped"] else 0)


def frames(times, sequence=None):
    numbers = sequence or range(len(times))
    return [(number, round(at * 1e6), 500_000) for number, at in zip(numbers, times, strict=True)]


def test_rate_and_jitter():
    found = frame_rate(frames([0, 21, 39, 60, 80]))
    assert found.rate == pytest.approx(50.0)
    assert found.period == pytest.approx(20.5)
    assert found.jitter == pytest.approx(1.2247, abs=1e-3)
    assert (found.dropped, found.out_of_order, found.longest) == (0, 0, 21.0)
    assert found.uncertainty == 0.5


def test_drops_and_disorder():
    found = frame_rate(frames([0, 20, 80, 100, 95], [0, 1, 4, 5, 6]))
    assert found.dropped == 2
    assert found.camera_rate == pytest.approx(6 / 0.095)
    assert found.out_of_order == 1
    assert "2 dropped" in str(found)


def test_too_few_frames_make_no_rate():
    with pytest.raises(ServiceError, match="2 frames came"):
        frame_rate(frames([0, 20]))
