"""`lidarboost quality` on recordings, files of maps, boards and a running rig."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread

import cv2
import numpy as np
import pytest
from publishing import publishing
from typer.testing import CliRunner

from drivers.calibration import Corrections, sr3000_calibration
from drivers.messages import calibration_message
from drivers.recording import RecordingWriter, open_recording
from service.cli import app
from service.messages.encoding import event_messages
from service.messages.events import FrameCaptured, MapFused
from service.messages.map import FusedMap
from service.wire.session import open_session


def lidarboost(*words: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall at 2 m, three bursts of two frames."""
    path = tmp_path_factory.mktemp("quality") / "wall.mcap"
    status, _, said = lidarboost("simulate", "--scene", "plane", "-n", 2, "--bursts", 3, "-o", path)
    assert status == 0, said
    return path


def figures(*words: object) -> dict:
    status, said, errors = lidarboost("quality", *words, "--json")
    assert status == 0, errors
    return json.loads(said)


def test_a_simulated_wall_is_measured_right(wall: Path) -> None:
    """Against the truth that the recording holds."""
    recording = open_recording(wall)
    first = [frame for frame in recording.frames() if frame.pose == 0]
    true = recording.truth.reshape(144, 4, 176, 4).mean(axis=(1, 3))
    errors = np.stack([frame.distance - true for frame in first])
    found = figures(wall, "--method", "nearest", "--distance", 2.0)
    assert (found["bursts"], found["frames"], found["method"]) == (3, 6, "nearest")
    cosine = 2.0 / true
    assert found["flatness"]["before"] == pytest.approx(np.sqrt(np.mean((errors * cosine) ** 2)), rel=0.05)
    assert found["noise"]["before"] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.05)
    means = errors.mean(axis=(1, 2))
    assert found["repeatability"]["before"] == pytest.approx(means.std(ddof=1), rel=0.05)
    assert abs(found["bias"]["before"]) < 1e-3
    assert found["fill"] == {"before": 1.0, "after": 1.0, "why": None}
    assert found["step"]["after"] is None
    (plane,) = found["regions"]
    assert (plane["name"], plane["away"]) == ("plane 1", pytest.approx(2.0, abs=2e-3))


def test_a_bias_is_found(wall: Path, tmp_path: Path) -> None:
    off = sr3000_calibration().model_copy(update={"corrections": Corrections(constant=0.02)})
    off.save(tmp_path / "off.toml")
    config = tmp_path / "rig.toml"
    config.write_text(f'[camera]\ncalibration = "{tmp_path / "off.toml"}"\n[fusion]\nmethod = "nearest"\n')
    found = figures(wall, "--config", config, "--distance", 2.0)
    assert found["bias"]["before"] == pytest.approx(-0.02, rel=0.05)
    assert found["bias"]["after"] == pytest.approx(-0.02, rel=0.05)


def test_requirements_give_the_exit_status(wall: Path) -> None:
    given = ("quality", wall, "--method", "nearest", "--require")
    status, said, _ = lidarboost(*given, "flatness<20mm", "--require", "fill>99%")
    assert status == 0
    assert said.count(": met, it is") == 2
    status, said, _ = lidarboost(*given, "flatness<1mm", "--require", "fill>99%")
    assert (status, "flatness<1mm: NOT met" in said) == (1, True)
    status, _, errors = lidarboost(*given, "bias<1mm", "--require", "flatness<1mm")
    assert (status, errors.splitlines()[-1]) == (
        2, "error: bias<1mm: bias cannot be measured: no true distance is known: give --distance, or --board",
    )  # fmt: skip
    status, said, _ = lidarboost(*given, "noise<1m", "--json")
    assert json.loads(said)["requirements"][0]["met"] is True


def darkened(path: Path, source: Path, *dark: int) -> Path:
    """The recording as it is with a cap on the lens during some of its bursts."""
    recording = open_recording(source)
    with RecordingWriter(path) as writer:
        writer.attach_calibration(recording.calibration, recording.entries[0].timestamp)
        for frame in recording.frames():
            seen = np.zeros_like(frame.counts) if frame.burst in dark else frame.counts
            writer.write_frame(replace(frame, counts=seen), recording.calibration.mount)
    return path


def test_a_burst_that_cannot_be_fused_is_passed_over_told_and_counted(wall: Path, tmp_path: Path) -> None:
    capped = darkened(tmp_path / "capped.mcap", wall, 1)
    words = ("quality", capped, "--method", "nearest")
    status, said, errors = lidarboost(*words)
    assert (status, said.splitlines()[0]) == (
        3, f"{capped}: 2 bursts (1 not fused), 4 frames, nearest, β = 4",
    )  # fmt: skip
    assert errors.count(f"lost: {capped}: burst 1 not fused: ") == 1
    status, said, _ = lidarboost(*words, "--json")
    found = json.loads(said)
    assert (status, found["bursts"], found["frames"], len(found["failures"])) == (3, 2, 4, 1)
    assert lidarboost(*words, "--bursts", 1)[0] == 0
    assert lidarboost(*words, "--require", "flatness<1mm")[0] == 1
    status, said, errors = lidarboost("quality", darkened(tmp_path / "all.mcap", wall, 0, 1, 2))
    assert (status, said) == (1, "")
    assert "all.mcap: no burst could be fused: burst 2 not fused: " in errors.splitlines()[-1]


@pytest.mark.slow
def test_maps_of_a_file_are_judged_as_they_are(wall: Path, tmp_path: Path) -> None:
    fused = tmp_path / "fused.mcap"
    assert lidarboost("fuse", wall, "--method", "nearest", "-o", fused)[0] == 0
    kept, made = figures(fused)["flatness"], figures(wall, "--method", "nearest")["flatness"]
    assert kept["before"] == made["before"]
    assert kept["after"] == pytest.approx(made["after"], rel=1e-5)
    one = figures(fused, "--bursts", 1)
    assert (one["bursts"], one["repeatability"]["after"]) == (1, None)


@pytest.mark.slow
def test_a_board_tells_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "board.mcap"
    assert lidarboost("simulate", "--scene", "board", "-n", 2, "--span", 0, "-o", path)[0] == 0
    drawn = tmp_path / "x.png"
    found = figures(path, "--board", "9x6", "--square", 50, "--method", "nearest", "--picture", drawn)
    assert abs(found["bias"]["before"]) < 5e-3  # 0.4 % of its distance, by corners of a small camera
    assert found["regions"][0]["name"] == "board"
    assert cv2.imread(str(drawn)).shape == (940, 1300, 3)
    status, _, errors = lidarboost("quality", path, "--board", "12x4", "--method", "nearest")
    assert (status, "no board of 12 x 4" in errors) == (1, True)


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--require", "flatness<<3"], 2, "--require 'flatness<<3': expected a figure"),
        (
            ["--region", "100,100,100,100", "--method", "nearest"],
            2,
            "reaches beyond the frame of 144 rows and 176 columns",
        ),
        (["--distance", 2, "--board", "9x6"], 2, "give one of them"),
        (["--preset", "nice"], 2, "preset = 'nice'"),
        (["--picture", "nowhere/x.png", "--method", "nearest"], 1, "nowhere/x.png: cannot be written"),
    ],
)
def test_bad_input_gets_one_line(wall: Path, words: list[object], status: int, said: str) -> None:
    found, _, errors = lidarboost("quality", wall, *words)
    assert found == status
    assert said in errors.splitlines()[-1]
    assert "Traceback" not in errors


def test_a_file_without_anything_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"")
    status, _, errors = lidarboost("quality", tmp_path / "x.mcap")
    assert (status, errors.startswith("error: ")) == (1, True)


def test_a_running_rig_is_judged(endpoint: str, fused: Callable[[int], FusedMap]) -> None:
    """Its frames are those of the maps that came with them."""
    done: list[tuple[int, str, str]] = []
    words = ("quality", "--endpoint", endpoint, "--bursts", 2, "--timeout", 30, "--json", "--region", "whole")
    asking = Thread(target=lambda: done.append(lidarboost(*words)))
    with open_session(listen=(endpoint,)) as session, publishing(session) as publisher:
        calibration = fused(0).calibration
        publisher.publish([calibration_message(calibration, fused(0).frame.timestamp)])
        asking.start()
        number = 0
        while asking.is_alive():
            number += 1
            shown = fused(number)
            shown = replace(shown, report=shown.report.model_copy(update={"sequence": (number,)}))
            publisher.publish(event_messages(FrameCaptured(shown.frame, shown.calibration.mount)))
            publisher.publish(event_messages(MapFused(shown, None)))
            asking.join(0.05)
    status, said, errors = done[0]
    assert status == 0, errors
    found = json.loads(said)
    assert (found["bursts"], found["upsampling"], found["method"]) == (2, 2, "nearest")
    assert found["flatness"]["before"] == pytest.approx(0.01, rel=0.1)
    assert found["fill"]["before"] == pytest.approx(1 - 144 / (36 * 44))
    assert found["noise"]["after"] == 0  # the same map again
    assert any("without the calibration's corrections" in note for note in found["notes"])


def test_a_rig_that_is_silent_is_told(endpoint: str) -> None:
    with open_session(listen=(endpoint,)) as session, publishing(session):
        status, _, errors = lidarboost("quality", "--endpoint", endpoint, "--timeout", 0.3)
    assert (status, "0 of 5 maps came" in errors) == (1, True)
