"""`import`, `info` and `recover` from the command line: what they print, their status, what they leave."""

import errno
import json
import os
import re
from io import FileIO

import numpy as np
import pytest
from typer.testing import CliRunner

import drivers.recording.output as output
from drivers import Frame, sr4000_calibration
from drivers.calibration import Mount
from drivers.recording import Recording, RecordingWriter, open_recording
from service.cli import app
from service.cli.info import _frame_lines

START = 1_700_000_000_000_000_000


def lidarboost(*arguments):
    """(status, standard output, standard error)"""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, done.stderr


def made_frame(number):
    random = np.random.default_rng(number)
    images = random.integers(1000, 60_000, (2, 144, 176), np.uint16)
    return Frame(
        *images,
        START + number * 20_000_000,
        number,
        0.001 * number,
        0.0,
        0.003,
        30e6,
        5.0,
        burst=number // 5,
        pose=number % 5,
    )


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "ten.mcap"
    with RecordingWriter(path, {"rig": "bench"}) as writer:
        writer.write_calibration(sr4000_calibration(), START)
        for number in range(10):
            writer.write_frame(made_frame(number), Mount())
    return path


def text_frame(path, milliseconds, confident=True):
    """A wall 2 m before an SR4000, without lens or noise."""
    rows, columns = np.mgrid[:144, :176]
    z = np.full((144, 176), 1.990)
    x, y = -2.0 * (columns - 87.5) / 252.36, -2.0 * (rows - 71.5) / 252.36
    images = (
        ("Calibrated Distance", z),
        ("Calibrated xVector", x),
        ("Calibrated yVector", y),
        ("Amplitude", np.full((144, 176), 800)),
        ("Confidence map", np.full((144, 176), 7 if confident else 0)),
    )
    with path.open("w") as file:
        for title, image in images:
            file.write(f"% {title}\n")
            np.savetxt(file, image, fmt="%.4f", delimiter="\t")
        file.write(f"% additional data / time stamp [ms]\n{milliseconds}\tnan\n")
    return path


def test_import_makes_a_recording_with_calibration(tmp_path):
    frames = [text_frame(tmp_path / f"f{number}.dat", 31 * number) for number in range(4)]
    output = tmp_path / "out.mcap"
    status, said, progress = lidarboost("import", *frames, "-o", output)
    assert status == 0
    assert "4 frames of 176 × 144 pixels in 1 burst" in said
    assert "SR4000 at 30 MHz (range 5.000 m), integration time not known, amplitude gray" in said
    assert "importing: 4 of 4 frames" in progress
    found = open_recording(output)
    assert found.calibration.intrinsics.fx == pytest.approx(252.36, abs=0.05)
    assert found.calibration.source.startswith("fitted to x, y, z of f0.dat: residual 0.00")
    assert "focal length 252.4 pixels, centre 87.5, 71.5 (fitted to x, y, z of f0.dat: residual" in said
    assert found.metadata["camera_model"] == "SR4000"
    (burst,) = found.bursts(99)
    assert [frame.timestamp for frame in burst] == [0, 31_000_000, 62_000_000, 93_000_000]
    assert burst[0].distance[71, 87] == pytest.approx(2.0, abs=0.001)


def test_import_takes_bursts_options_and_a_calibration_file(tmp_path):
    frames = [text_frame(tmp_path / f"f{number}.dat", 31 * number) for number in range(3)]
    calibration = sr4000_calibration().model_copy(update={"source": "my own"})
    calibration.save(tmp_path / "my.toml")
    (tmp_path / "my.toml").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "my.toml").read_bytes())
    arguments = ["--burst", 2, "--integration-time", 3.2, "--calibration", tmp_path / "my.toml", "--json"]
    status, said, _ = lidarboost("import", *frames, "-o", tmp_path / "out.mcap", *arguments)
    assert status == 0
    assert json.loads(said)["bursts"] == 2
    assert (json.loads(said)["optics"], json.loads(said)["optics_residual"]) == ("my own", None)
    found = open_recording(tmp_path / "out.mcap")
    assert [len(burst) for burst in found.bursts(99)] == [2, 1]
    assert found.calibration == calibration
    assert {frame.integration_time for frame in found.frames()} == {0.0032}


@pytest.mark.parametrize(("arguments", "planned"), [([], 9), (["--burst", 12], 12)])
def test_a_torn_import_says_what_its_only_burst_lacks(tmp_path, arguments, planned):
    frames = [text_frame(tmp_path / f"f{number}.dat", 31 * number) for number in range(9)]
    output = tmp_path / "out.mcap"
    assert lidarboost("import", *frames, "-o", output, *arguments)[0] == 0
    output.write_bytes(output.read_bytes()[: output.stat().st_size * 2 // 3])
    found = open_recording(output)
    assert 1 < found.frame_count < 9
    assert f"burst 0 has {found.frame_count} of {planned} frames" in str(found.damage)


def test_import_leaves_nothing_behind_when_a_later_frame_is_bad(tmp_path):
    good = text_frame(tmp_path / "good.dat", 0)
    torn = tmp_path / "torn.dat"
    torn.write_text(good.read_text()[:200_000])
    status, _, said = lidarboost("import", good, torn, "-o", tmp_path / "out.mcap")
    assert status == 1
    assert re.search(
        r"^error: .*torn\.dat: (has 2 sections|image x has \d+ × 176 values)", said, re.MULTILINE
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["good.dat", "torn.dat"]


def test_import_does_not_replace_a_file_unasked(tmp_path):
    frame = text_frame(tmp_path / "f.dat", 0)
    (tmp_path / "out.mcap").write_bytes(b"precious")
    status, _, said = lidarboost("import", frame, "-o", tmp_path / "out.mcap")
    assert (status, (tmp_path / "out.mcap").read_bytes()) == (1, b"precious")
    assert "out.mcap exists already" in said
    assert lidarboost("import", frame, "-o", tmp_path / "out.mcap", "--force")[0] == 0
    assert open_recording(tmp_path / "out.mcap").frame_count == 1


@pytest.mark.parametrize(
    ("arguments", "status"),
    [(["import"], 2), (["import", "a.dat"], 2), (["import", "a.dat", "-o", "b.mcap", "--burst", 0], 2)],
)
def test_wrong_usage_has_status_2(arguments, status):
    assert lidarboost(*arguments)[0] == status


def test_info_shows_what_is_inside(recording):
    status, said, _ = lidarboost("info", recording)
    assert status == 0
    for line in (
        r"frames +10 of 176 × 144 pixels, 50\.00 Hz, over 0\.180 s, none dropped",
        r"settings +integration time 3 ms; modulation 30 MHz \(range 5\.000 m\); amplitude linear",
        r"burst +burst 1: 5 frames, pan 0\.286° to 0\.516°, tilt 0\.000° to 0\.000°",
        r"calibration +f = 252\.\d\d, 252\.\d\d px, centre 87\.50, 71\.50 px",
        r"topic +camera/distance +10 × foxglove\.RawImage, 50\.00 Hz",
        r"attachment +calibration\.toml +0\.\d kB, application/toml",
        r"metadata +rig = bench",
        r"damage +none, checksums agree",
    ):
        assert re.search(f"^{line}", said, re.MULTILINE), line


def test_info_does_not_blame_the_camera_for_every_gap(recording):
    frames = Recording(recording).summary().frames.model_copy(update={"drops": 3, "passed": 7})
    told = dict(_frame_lines(frames))["frames"]
    assert "3 dropped by the camera (7 passed while the stage turned or between bursts)" in told


def test_info_of_a_torn_file_says_what_is_missing_with_status_3(recording):
    recording.write_bytes(recording.read_bytes()[:500_000])
    status, said, _ = lidarboost("info", recording)
    assert status == 3
    assert re.search(r"^damage +torn at byte [\d,]+, [\d,]+ bytes unusable", said, re.MULTILINE)
    status, said, _ = lidarboost("info", recording, "--json")
    assert status == 3
    summary = json.loads(said)
    assert summary["damage"]["parts"][0]["part"] == "end"
    assert summary["damage"]["short_bursts"][0]["burst"] == 0
    assert summary["frames"]["count"] < 10


@pytest.mark.parametrize("content", [b"", b"something else entirely"])
def test_info_of_what_is_no_recording_is_one_line(tmp_path, content):
    (tmp_path / "x.mcap").write_bytes(content)
    status, said, error = lidarboost("info", tmp_path / "x.mcap")
    assert (status, said) == (1, "")
    assert error.startswith("error: ")
    assert error.count("\n") == 1


def test_recover_saves_what_there_is_with_status_3(recording, tmp_path):
    recording.write_bytes(recording.read_bytes()[:500_000])
    status, said, _ = lidarboost("recover", recording)
    assert status == 3
    assert "lost: torn at byte" in said
    assert lidarboost("info", tmp_path / "ten.recovered.mcap")[0] == 0


def test_recover_on_a_full_disk_is_one_line_and_leaves_nothing(recording, tmp_path, monkeypatch):
    class FullDisk(FileIO):
        def write(self, _):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(output, "open_unbuffered", lambda path: FullDisk(path, "x+"))
    status, said, error = lidarboost("recover", recording, "-o", tmp_path / "saved.mcap")
    assert (status, said, error.count("\n")) == (1, "", 1)
    assert error.startswith(
        f"error: {tmp_path / 'saved.mcap'}: cannot be written: the disk is full: free some"
    )
    assert list(tmp_path.iterdir()) == [recording]


def test_recover_of_a_whole_file_has_status_0(recording, tmp_path):
    status, said, _ = lidarboost("recover", recording, "-o", tmp_path / "copy.mcap")
    assert (status, "nothing was missing" in said) == (0, True)
    assert open_recording(tmp_path / "copy.mcap").frame_count == 10


def test_what_holds_nothing_is_not_sent_to_be_recovered(tmp_path):
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(bytes.fromhex("894d434150300d0a") + b"\x01\xff")
    status, said, _ = lidarboost("info", empty)
    assert status == 3
    assert "recover" not in said
