"""Which recording goes when there is no room: the oldest by what the files say, none that is in use."""

import errno
import os
from pathlib import Path

import pytest
from scripted import calibration, frame
from test_recorder import Time, section

from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording
from service.sinks import recording_directory
from service.sinks.recording_directory import RecordingDirectory


def test_the_oldest_by_number_goes_first_whatever_the_clock_says(tmp_path: Path) -> None:
    clock = Time()
    directory = RecordingDirectory(section(tmp_path, rotate_size=1, budget=4), clock)

    def record() -> str:
        path = directory.next_path()
        path.write_bytes(bytes(1_000_000))
        seconds = clock.now / 1e9
        os.utime(path, (seconds, seconds))
        return path.name

    before = [record() for _ in range(3)]
    clock.now = 3_600 * 10**9  # a power cut, and no battery: 1970
    after = [record() for _ in range(3)]
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == sorted([before[2], *after])
    clock.now = 1_800_000_000 * 10**9
    newest = [record() for _ in range(3)]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([after[2], *newest])


def test_a_file_that_may_not_be_read_is_listed_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path) -> bool:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    (tmp_path / "theirs.mcap").write_bytes(b"")
    monkeypatch.setattr(recording_directory, "has_footer", refused)
    [told] = RecordingDirectory(section(tmp_path), Time()).files()
    assert (told.file, told.state) == ("theirs.mcap", "whole")


def test_a_recording_that_is_played_or_read_is_never_deleted(tmp_path: Path) -> None:
    directory = RecordingDirectory(section(tmp_path, rotate_size=1, budget=3), Time())
    played = directory.next_path()
    with RecordingWriter(played) as writer:
        writer.write_calibration(calibration(), 0)
        for number in range(3):
            writer.write_frame(frame(number, 10**18 + number), Mount())
    reader = open_recording(played)
    for _ in range(6):
        directory.next_path().write_bytes(bytes(1_000_000))
    assert played.exists()
    assert len(list(reader.frames())) == 3
    del reader
    for _ in range(3):
        directory.next_path().write_bytes(bytes(1_000_000))
    assert not played.exists()
