"""What may become of the place where recordings are kept, on real file systems where that can be done."""

import errno
import fcntl
import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scripted import calibration, frame
from test_recorder import HEAD, Time, begun, message, opened, read, recorder, said, section

import service.sinks.recording_series as series_module
from drivers.calibration import Mount
from drivers.recording import RecordingWriter, open_recording
from service.messages.events import FrameCaptured
from service.sinks.file_series import FileSeries
from service.sinks.recorder import Recorder
from service.sinks.recording_directory import RecordingDirectory
from service.sinks.recording_order import RecordingOrder, Wish

SIZE = 200_000


def mounted(path: Path, *options: str) -> bool:
    command = ["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(path)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if shutil.which("mount") is None or not mounted(folder, "size=3m"):
        pytest.skip("file systems cannot be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], capture_output=True, check=False)


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look and try again with every event."""
    monkeypatch.setattr(series_module, "_RETRY", 0.0)


def counted(recording: Recorder, sent: int) -> set[int]:
    """The messages in its files; each of the others has been counted."""
    found = {number for path in recording.files for _, number, _ in read(Path(path))}
    assert recording.lost == sent - len(found)
    assert recording.state.messages == len(found)
    return found


def until(recording: Recorder, happened: Callable[[], bool], sent: int = 0) -> int:
    for number in range(sent, sent + 200):
        recording.take(said(message(number, SIZE)))
        if happened():
            return number + 1
    pytest.fail("it did not happen")


def test_a_full_disk_stops_the_recording_alone_and_it_goes_on_when_there_is_room(disk: Path) -> None:
    recording = recorder(FileSeries(disk / "a.mcap", 1000, None))
    sent = until(recording, lambda: recording.fault is not None)
    assert "the disk is full" in (recording.fault or "")
    assert recording.state.error == recording.fault
    for number in range(sent, sent + 40):
        recording.take(said(message(number, SIZE)))
    lost = recording.lost
    assert lost > 20
    first = Path(recording.files[0])
    for path in list(disk.iterdir()):
        if path != first:
            path.unlink()
    shutil.move(first, disk.parent / "a.mcap")
    recording.take(said(message(1000, SIZE)))
    recording.take(said(message(1001, SIZE)))
    assert recording.fault is None
    assert recording.state.recording
    recording.close()
    assert {1000, 1001} <= {number for path in recording.files for _, number, _ in read(Path(path))}
    assert [number for _, number, _ in read(disk.parent / "a.mcap")][:2] == [0, 1]


def test_what_a_full_disk_cost_is_counted_message_by_message(disk: Path) -> None:
    recording = recorder(FileSeries(disk / "a.mcap", 1000, None))
    sent = until(recording, lambda: recording.lost > 10)
    recording.close()
    found = counted(recording, sent)
    assert 5 < len(found) < sent


def test_a_disk_that_is_full_at_the_start_is_waited_for(disk: Path) -> None:
    (disk / "full").write_bytes(bytes(3 * 1024**2 - 8192))
    recording = recorder(RecordingDirectory(section(disk / "recordings"), Time()))
    sent = until(recording, lambda: recording.lost > 3)
    assert recording.fault is not None
    assert not list(disk.glob("recordings/*"))
    (disk / "full").unlink()
    recording.take(said(message(sent, SIZE)))
    recording.close()
    assert counted(recording, sent + 1) == {sent}


def test_the_preroll_bridges_a_short_fault(disk: Path) -> None:
    recording = Recorder(FileSeries(disk / "a.mcap", 1000, None), preroll=60.0, now=Time())
    recording.take(opened())
    (disk / "full").write_bytes(bytes(2 * 1024**2))
    sent = until(recording, lambda: recording.fault is not None)
    (disk / "full").unlink()
    for number in range(sent, sent + 3):
        recording.take(said(message(number, SIZE)))
    recording.close()
    assert counted(recording, sent + 3) == set(range(sent + 3))


@pytest.mark.parametrize("how", ["deleted", "unmounted", "mounted over"])
def test_a_folder_that_vanishes_is_noticed_and_recording_goes_on_in_a_new_one(disk: Path, how: str) -> None:
    recording = recorder(RecordingDirectory(section(disk / "recordings"), Time()))
    sent = until(recording, lambda: recording.state.size > 500_000)
    former = recording.state.file
    if how == "deleted":
        shutil.rmtree(disk / "recordings")
    elif how == "unmounted":
        subprocess.run(["umount", "-l", str(disk)], check=True)
    else:
        assert mounted(disk / "recordings", "size=3m")
    try:
        until(recording, lambda: recording.fault is None and recording.state.recording, sent)
        assert recording.lost >= sent - 3
        recording.take(said(message(999, SIZE)))
        recording.close()
        assert former not in recording.files or how != "deleted"
        assert any("is gone" in loss for loss in recording.losses)
        assert read(Path(recording.files[-1]))[-1][1] == 999
    finally:
        if how == "mounted over":
            subprocess.run(["umount", "-l", str(disk / "recordings")], check=True)


def test_a_folder_that_vanishes_before_the_end_is_not_said_to_have_been_written(tmp_path: Path) -> None:
    recording = recorder(RecordingDirectory(section(tmp_path / "recordings"), Time()))
    for number in range(4):
        recording.take(said(message(number, SIZE)))
    shutil.rmtree(tmp_path / "recordings")
    recording.close()
    assert recording.files == ()
    assert recording.lost == 4
    assert any("is gone" in loss for loss in recording.losses)


def test_a_read_only_disk_loses_nothing_of_what_was_written_and_promises_nothing(disk: Path) -> None:
    recording = recorder(RecordingDirectory(section(disk / "recordings"), Time()))
    sent = until(recording, lambda: recording.state.size > 500_000)
    path = Path(recording.state.file or "")
    # With a file open for writing the system refuses to turn read-only; the folder's entries can be frozen.
    subprocess.run(["mount", "--bind", str(disk), str(disk)], check=True)
    subprocess.run(["mount", "-o", "remount,bind,ro", str(disk)], check=True)
    try:
        recording.close()
        assert recording.files == ()
        assert any("read-only" in loss for loss in recording.losses)
        assert not path.exists()
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)
    again = recorder(RecordingDirectory(section(disk / "recordings"), Time()))
    again.take(said(message(sent)))
    assert again._recovery is not None
    assert again._recovery.wait(20)
    again.close()
    assert len(read(path)) >= sent - 3


def killed_while_recording(folder: Path, frames: int) -> Path:
    """What a service leaves that was killed after so many frames."""
    script = (
        "import os, sys; sys.path[:0] = sys.argv[3:]\n"
        "from test_recorder_faults import film; film(sys.argv[1], int(sys.argv[2]))\n"
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


def test_a_recording_begins_with_what_came_before_it_was_asked_for(tmp_path: Path) -> None:
    order = RecordingOrder(None)
    recording = Recorder(FileSeries(tmp_path / "a.mcap", 10, None), order=order, preroll=60.0, now=Time())
    recording.take(opened())
    for number in range(5):
        recording.take(said(message(number)))
    assert list(tmp_path.iterdir()) == []
    assert not recording.state.recording
    order.wish = Wish()
    recording.take(said(message(5)))
    assert recording.state.recording
    order.wish = None
    recording.take(said(message(6)))
    assert not recording.state.recording
    recording.close()
    assert [number for _, number, _ in read(tmp_path / "a.mcap")] == [0, 1, 2, 3, 4, 5]
    assert recording.lost == 0
    assert HEAD.metadata == {"rig": "bench"}
