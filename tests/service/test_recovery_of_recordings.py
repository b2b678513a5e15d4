"""What a crash leaves of a recording becomes a whole file with the next start, or is set aside."""

import errno
import fcntl
import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from scripted import frame
from test_recorder import Time, begun, message, recorder, said, section

from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording
from service.messages.events import FrameCaptured
from service.sinks.recording_directory import RecordingDirectory

SIZE = 200_000


def killed_while_recording(folder: Path, frames: int) -> Path:
    """What a service leaves that was killed after so many frames."""
    script = (
        "import os, sys; sys.path[:0] = sys.argv[3:]\n"
        "from test_recovery_of_recordings import film; film(sys.argv[1], int(sys.argv[2]))\n"
        "print('ready', flush=True); import signal; signal.pause()"
    )
    here = str(Path(__file__).parent)
    root = str(Path(__file__).parents[2])
    child = subprocess.Popen(
        [sys.executable, "-c", script, str(folder), str(frames), here, root],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "ready\n"
    child.send_signal(signal.SIGKILL)
    child.wait()
    child.stdout.close()
    (active,) = folder.glob("*.active")
    return active


def film(folder: str, frames: int) -> None:
    """Record frames, and leave the file open."""
    film.recording = recorder(RecordingDirectory(section(Path(folder)), time.time_ns))  # type: ignore[attr-defined]
    for number in range(frames):
        one = frame(number, 10**18 + number * 10**7, burst=0, pose=number)
        film.recording.take(FrameCaptured(one, Mount()))  # type: ignore[attr-defined]


def test_after_a_kill_three_frames_at_most_are_missing_and_the_next_start_makes_a_whole_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    active = killed_while_recording(tmp_path, 50)
    with active.open("ab") as stream:
        stream.write(b"\x06\xff\xff")  # the last write went half through
    recording = recorder(RecordingDirectory(section(tmp_path), Time()))
    with caplog.at_level(logging.WARNING):
        recording.take(said(message(1)))
        assert recording._recovery is not None
        assert recording._recovery.wait(20)
    recording.close()
    whole = active.with_name(active.name.removesuffix(".active"))
    found = open_recording(whole)
    assert found.damage is None
    assert 47 <= found.frame_count <= 50
    assert f"{whole}: {found.frame_count} frames were saved" in caplog.text
    assert sorted(tmp_path.iterdir()) == sorted([whole, Path(recording.files[0])])


def test_what_cannot_be_recovered_is_set_aside_and_goes_with_the_oldest(tmp_path: Path) -> None:
    for number in (1, 2):
        (tmp_path / f"20260101T00000{number}Z-00000{number}.mcap.active").write_bytes(bytes(900_000))
    directory = RecordingDirectory(section(tmp_path, rotate_size=1, budget=4), Time())
    recording = recorder(directory)
    recording.take(said(message(0)))
    assert recording._recovery is not None
    assert recording._recovery.wait(20)
    names = {path.name for path in tmp_path.iterdir()}
    assert {"20260101T000001Z-000001.torn.mcap", "20260101T000002Z-000002.torn.mcap"} <= names
    for number in range(60):
        recording.take(begun(message(number, SIZE)))
    recording.close()
    assert recording.lost == 0
    assert not list(tmp_path.glob("*torn*"))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 4_300_000


def test_a_recovery_that_was_killed_is_begun_anew(tmp_path: Path) -> None:
    active = killed_while_recording(tmp_path, 20)
    whole = active.with_name(active.name.removesuffix(".active"))
    active.rename(whole.with_suffix(".torn.mcap"))
    active.write_bytes(b"the beginning of a copy")
    recording = recorder(RecordingDirectory(section(tmp_path), Time()))
    recording.take(said(message(1)))
    assert recording._recovery is not None
    assert recording._recovery.wait(20)
    recording.close()
    assert open_recording(whole).frame_count >= 17
    assert not list(tmp_path.glob("*torn*"))


def test_a_file_that_another_service_writes_is_left_alone(tmp_path: Path) -> None:
    directory = RecordingDirectory(section(tmp_path, rotate_size=1, budget=3), Time())
    other = RecordingWriter(tmp_path / "20260101T000000Z-000001.mcap")
    recording = recorder(directory)
    for number in range(60):
        recording.take(begun(message(number, SIZE)))
    assert (tmp_path / "20260101T000000Z-000001.mcap.active").exists()
    recording.close()
    other.close()
    assert (tmp_path / "20260101T000000Z-000001.mcap").exists()


def test_a_share_without_locks_is_recorded_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    monkeypatch.setattr(fcntl, "flock", refused)
    left = killed_while_recording(tmp_path, 10)
    recording = recorder(RecordingDirectory(section(tmp_path), Time()))
    recording.take(said(message(1)))
    assert recording._recovery is not None
    assert recording._recovery.wait(30)
    recording.close()
    assert len(recording.files) == 1
    assert "has no file locks" in caplog.text
    # What does not grow any more was left by somebody.
    assert open_recording(left.with_name(left.name.removesuffix(".active"))).frame_count >= 7
