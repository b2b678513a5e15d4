"""What is no recording, or none that makes sense, is refused in one line."""

import re
from dataclasses import replace

import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from made_frames import START, make_frame
from made_recordings import write
from typer.testing import CliRunner

from drivers import RecordingError, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import calibration_message, frame_messages
from drivers.recording import RecordingWriter, open_recording
from service.cli import app


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty (0 bytes); expected an MCAP recording"),
        (
            b"\x00" * 100,
            "is not MCAP (begins with 00 00 00 00 00 00 00 00, expected 89 4d 43 41 50 30 0d 0a)",
        ),
        (b"\x89MC", "is not MCAP"),
        (b"\x89MCAP0\r\n", "holds no whole frame"),
    ],
)
def test_what_is_not_a_recording_is_refused_in_one_line(tmp_path, content, said):
    path = tmp_path / "odd.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="No such file"):
        open_recording(tmp_path / "nothing.mcap")
    with pytest.raises(RecordingError, match="Is a directory"):
        open_recording(tmp_path)


def test_recording_without_frames_is_refused(tmp_path):
    write(tmp_path / "none.mcap", [])
    with pytest.raises(RecordingError, match="holds no whole frame"):
        open_recording(tmp_path / "none.mcap")


def test_frames_of_two_sizes_are_refused(tmp_path):
    write(tmp_path / "x.mcap", [make_frame(0), make_frame(1, shape=(124, 160))])
    with pytest.raises(RecordingError, match="frame 101 has 124 × 160 pixels, frame 100 144 × 176"):
        open_recording(tmp_path / "x.mcap")


def test_frames_of_another_size_than_the_calibration_are_refused(tmp_path):
    write(tmp_path / "x.mcap", [make_frame(0, shape=(124, 160))], sr4000_calibration())
    with pytest.raises(
        RecordingError, match="frame 100 has 124 × 160 pixels, its calibration is for 144 × 176"
    ):
        open_recording(tmp_path / "x.mcap")


def test_images_that_do_not_fit_each_other_are_refused(tmp_path):
    frame = make_frame(0)
    small = make_frame(0, shape=(10, 10))
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        messages = frame_messages(frame, Mount())
        for message in (frame_messages(small, Mount())[0], *messages[1:]):
            writer.write(message, START)
    with pytest.raises(RecordingError, match=r"holds no whole frame.*images of frame 100 do not fit"):
        open_recording(tmp_path / "x.mcap")


def test_missing_calibration_is_told_when_it_is_asked_for(tmp_path):
    recording = open_recording(write(tmp_path / "x.mcap", [make_frame(0)]))
    with pytest.raises(
        RecordingError, match=r"holds no calibration; expected the attachment calibration\.toml"
    ):
        _ = recording.calibration


def test_frame_without_its_amplitude_is_told(tmp_path):
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        for number in range(3):
            for message in frame_messages(make_frame(number), Mount()):
                if number != 1 or message.topic != "camera/amplitude":
                    writer.write(message, START)
    recording = open_recording(tmp_path / "x.mcap")
    assert [frame.sequence for frame in recording.frames()] == [100, 102]
    assert str(recording.damage) == "incomplete frames: 101"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (
            {"K": [0.0] * 9},
            r"no calibration \(it says that the camera is not calibrated: K is zero\); expected",
        ),
        (
            {"distortion_model": "kannala_brandt", "D": [0.1, -0.05, 0.02, -0.01]},
            "camera/calibration: the lens model 'kannala_brandt' cannot be used here",
        ),
        ({"distortion_model": "equidistant"}, "the lens model 'equidistant' cannot be used here"),
        ({"K": [200.0] * 5}, "K has 5 values; expected 9"),
    ],
)
def test_a_lens_that_cannot_be_used_is_refused_by_fuse_and_told_by_info(tmp_path, fields, said):
    whole = calibration_message(sr4000_calibration(), START)
    lens = CameraCalibration.FromString(whole.payload)
    for name in fields:
        lens.ClearField(name)
    lens.MergeFrom(CameraCalibration(**fields))
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write(replace(whole, payload=lens.SerializeToString()), START)
        for message in frame_messages(make_frame(0), Mount()):
            writer.write(message, START)
    for command, where in (("info", "stdout"), ("fuse", "stderr")):
        done = CliRunner().invoke(app, [command, str(tmp_path / "x.mcap")])
        assert done.exit_code == (0 if command == "info" else 1)
        assert re.search(f"x.mcap: .*{said}", getattr(done, where))
        assert "internal error" not in done.output
