"""What may become of the place where recordings are kept, on real file systems where that can be done."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_recorder import HEAD, Time, message, opened, read, recorder, said, section

import service.sinks.recording_series as series_module
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
