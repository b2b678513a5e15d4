import errno
import os
import re
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

import drivers.recording.output as output
from drivers.messages import Message, Schema
from drivers.recording import RecordingHead
from service.config.sections import RecordingSection
from service.messages.encoding import event_messages
from service.messages.events import BurstCaptured, Event, HeadChanged
from service.sinks.bus import Bus
from service.sinks.file_series import FileSeries
from service.sinks.recorder import Recorder
from service.sinks.recording_directory import RecordingDirectory

SCHEMA = Schema("lidarboost.Status", "jsonschema", b'{"type": "object"}')
SECOND = 1_000_000_000


class Time:
    def __init__(self) -> None:
        self.now = 1_700_000_000 * SECOND

    def __call__(self) -> int:
        self.now += SECOND
        return self.now


def message(number: int, size: int = 100, topic: str = "status") -> Message:
    payload = b'{"noise": "' + os.urandom(size // 2).hex().encode() + b'"}'
    return Message(topic, SCHEMA, payload, number, number)


def read(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [(c.topic, m.sequence, m.data) for _, c, m in reader.iter_messages(log_time_order=False)]


HEAD = RecordingHead({"rig": "bench"}, (("configuration.toml", b"x = 1", "application/toml"),))


def opened() -> HeadChanged:
    """What every file begins with."""
    return HeadChanged(HEAD)


def made_of(event: Event, *messages: Message) -> Event:
    """An event whose messages are these."""
    event.once(event_messages, lambda: messages)
    return event


def said(*messages: Message) -> Event:
    return made_of(Event(), *messages)


def begun(*messages: Message) -> Event:
    """A burst's."""
    return made_of(BurstCaptured(None, 1), *messages)  # type: ignore[arg-type]


def recorder(destination: FileSeries | RecordingDirectory) -> Recorder:
    made = Recorder(destination, now=Time())
    made.take(opened())
    return made


def section(directory: Path, **changes: float) -> RecordingSection:
    return RecordingSection.model_validate({"directory": directory, **changes})


def test_what_is_recorded_is_what_was_handed_over_byte_for_byte(tmp_path: Path) -> None:
    recording = recorder(FileSeries(tmp_path / "out" / "fused.mcap", 1000, None))
    sent = [message(number, 200_000) for number in range(40)]
    path = tmp_path / "out" / "fused.mcap"
    for one in sent:
        recording.take(said(one))
    assert path.with_name("fused.mcap.active").exists()
    assert not path.exists()
    assert recording.state.recording
    recording.close()
    assert (recording.state.recording, recording.state.messages) == (False, 40)
    assert recording.files == (str(path),)
    assert read(path) == [("/status", one.sequence, one.payload) for one in sent]
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert {a.name: a.data for a in reader.iter_attachments()}["configuration.toml"] == b"x = 1"
        assert next(reader.iter_metadata()).metadata["rig"] == "bench"


def test_topics_that_the_table_does_not_record_are_left_out(tmp_path: Path) -> None:
    recording = recorder(FileSeries(tmp_path / "a.mcap", 1000, None))
    recording.take(said(message(1), message(2, topic="scan/progress")))
    recording.take(said(message(3, topic="scan/progress")))
    recording.close()
    assert [topic for topic, _, _ in read(tmp_path / "a.mcap")] == ["/status"]


def test_discarding_leaves_nothing_behind(tmp_path: Path) -> None:
    recording = recorder(FileSeries(tmp_path / "fused.mcap", 1000, None))
    recording.take(said(message(1)))
    recording.discard()
    assert list(tmp_path.iterdir()) == []


def test_files_of_one_series_never_overwrite_another_and_keep_a_budget(tmp_path: Path) -> None:
    (tmp_path / "fused.mcap").write_bytes(b"of an earlier run")
    recording = recorder(FileSeries(tmp_path / "fused.mcap", 1, 3))
    for number in range(60):
        recording.take(begun(message(number, 200_000)))
    recording.close()
    assert (tmp_path / "fused.mcap").read_bytes() == b"of an earlier run"
    files = sorted(tmp_path.glob("fused-*.mcap"), key=lambda path: path.stat().st_mtime_ns)
    assert 2 <= len(files) <= 4
    assert sum(path.stat().st_size for path in files) < 3_600_000
    kept = [sequence for path in files for _, sequence, _ in read(path)]
    assert kept == list(range(kept[0], 60))


def test_files_turn_over_between_bursts_and_the_oldest_unmarked_goes(tmp_path: Path) -> None:
    directory = RecordingDirectory(section(tmp_path, rotate_size=1, budget=4), Time())
    recording = recorder(directory)
    bystander = tmp_path / "wedges.mcap"
    bystander.write_bytes(bytes(5_000_000))
    number = 0
    kept: Path | None = None
    for _ in range(12):
        # A burst of 0.5 MB (hexadecimal noise halves when it is compressed).
        recording.take(begun(message(number, 1000, "camera/calibration")))
        if kept is None:
            kept = Path(recording.state.file or "")
            directory.keep(kept)
        for _ in range(5):
            number += 1
            recording.take(said(message(number, 200_000)))
    recording.close()
    assert kept is not None
    files = sorted(path for path in tmp_path.glob("2*.mcap"))
    assert kept in files
    assert sum(path.stat().st_size for path in files) <= 4_600_000
    assert bystander.stat().st_size == 5_000_000
    for path in files:
        assert read(path)[0][0] == "/camera/calibration"
    survivors = [
        sequence for path in files if path != kept for topic, sequence, _ in read(path) if topic == "/status"
    ]
    assert survivors == list(range(survivors[0], 61))
    assert survivors[0] > 11


def test_one_endless_burst_is_cut_a_little_over_the_limit(tmp_path: Path) -> None:
    recording = recorder(RecordingDirectory(section(tmp_path, rotate_size=1), Time()))
    for number in range(30):
        recording.take(said(message(number, 200_000)))
    recording.close()
    files = sorted(tmp_path.glob("2*.mcap"))
    assert len(files) > 2
    assert max(path.stat().st_size for path in files) < 1_700_000
    assert [sequence for path in files for _, sequence, _ in read(path)] == list(range(30))


def test_kept_recordings_that_fill_the_budget_stop_the_recorder_and_say_so(tmp_path: Path) -> None:
    for day in (1, 2, 3):
        (tmp_path / f"2026010{day}T000000Z.mcap").write_bytes(bytes(1_000_000))
        (tmp_path / f"2026010{day}T000000Z.mcap.keep").touch()
    recording = recorder(RecordingDirectory(section(tmp_path, rotate_size=1, budget=3), Time()))
    recording.take(said(message(1)))
    assert re.search(r"marked to keep.* 3 MB.*recording\.budget", recording.fault or "")
    assert recording.lost == 1
    assert len(list(tmp_path.glob("*.mcap"))) == 3


class FullDisk(output.FileIO):
    """A file on a disk with room for 500 kB."""

    room = 500_000

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


def test_a_full_disk_is_seen_in_the_states_and_whatever_is_in_no_file_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = Bus()
    with monkeypatch.context() as full:
        full.setattr(output, "open_unbuffered", lambda path: FullDisk(path, "x+"))
        bus.add("recorder", lambda: Recorder(FileSeries(tmp_path / "a.mcap", 1000, None)))
        bus.emit(opened())
        sent = 0
        deadline = time.monotonic() + 30
        while bus.states[0].state == "running":
            bus.emit(said(message(sent, 200_000)))
            sent += 1
            assert time.monotonic() < deadline
        assert "the disk is full" in (bus.states[0].error or "")
    while bus.states[0].state != "running":
        assert time.monotonic() < deadline
        bus.emit(said(message(sent)))
        sent += 1
        time.sleep(0.1)
    bus.emit(said(message(9999)))
    bus.close(20)
    first, *_, last = map(Path, bus.files)
    kept = [sequence for _, sequence, _ in read(first)]
    assert kept == list(range(len(kept)))
    assert len(kept) >= 2
    assert read(last)[-1][1] == 9999
    written = {sequence for path in map(Path, bus.files) for _, sequence, _ in read(path)}
    missing = (sent + 1) - len(written)
    assert missing == sum(state.dropped for state in bus.states) > 0
    assert any(f"recorder: {missing} messages lost" in loss for loss in bus.losses)
