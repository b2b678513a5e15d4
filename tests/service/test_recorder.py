import errno
import os
import threading
from pathlib import Path

import pytest
from mcap.reader import make_reader

import drivers.recording.output as output
from drivers.messages import Message, Schema
from drivers.recording import RecordingHead
from service.config import RecordingSection
from service.errors import OutputError, ServiceError
from service.output.recorder import Recorder
from service.output.shelf import Shelf, SingleFile
from service.wire.outbox import Outbox

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


def section(directory: Path, **changes: float) -> RecordingSection:
    return RecordingSection.model_validate({"directory": directory, **changes})


def test_what_is_recorded_is_what_was_handed_over_byte_for_byte(tmp_path: Path) -> None:
    head = RecordingHead({"rig": "bench"}, (("configuration.toml", b"x = 1", "application/toml"),))
    recorder = Recorder(SingleFile(tmp_path / "out" / "fused.mcap"), lambda: head, lossless=True)
    sent = [message(number, 200_000) for number in range(40)]
    path = recorder.start()
    assert path.with_name("fused.mcap.active").exists()
    assert not path.exists()
    for one in sent:
        recorder.record([one])
    state = recorder.stop()
    assert (state.recording, state.messages, state.dropped, state.error) == (False, 40, 0, None)
    assert read(path) == [("/status", one.sequence, one.payload) for one in sent]
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert {a.name: a.data for a in reader.iter_attachments()}["configuration.toml"] == b"x = 1"
        assert next(reader.iter_metadata()).metadata["rig"] == "bench"


def test_topics_that_the_table_does_not_record_are_left_out(tmp_path: Path) -> None:
    recorder = Recorder(SingleFile(tmp_path / "a.mcap"))
    path = recorder.start()
    recorder.record([message(1), message(2, topic="fused/points")])
    recorder.record([message(3, topic="fused/points")])
    assert recorder.stop().messages == 1
    assert [topic for topic, _, _ in read(path)] == ["/status"]


def test_discarding_leaves_nothing_behind(tmp_path: Path) -> None:
    recorder = Recorder(SingleFile(tmp_path / "fused.mcap"), lossless=True)
    recorder.start()
    recorder.record([message(1)])
    recorder.discard()
    assert list(tmp_path.iterdir()) == []
    assert recorder.state.error is None


def test_a_stopped_recorder_takes_nothing_and_starts_again_in_a_new_file(tmp_path: Path) -> None:
    recorder = Recorder(Shelf(section(tmp_path), Time()))
    recorder.record([message(1)])
    first = recorder.start()
    assert recorder.start() == first
    recorder.record([message(2)])
    recorder.stop()
    recorder.record([message(3)])
    second = recorder.start()
    recorder.record([message(4)])
    recorder.stop()
    assert first != second
    assert [sequence for path in (first, second) for _, sequence, _ in read(path)] == [2, 4]


def test_files_turn_over_between_bursts_and_the_oldest_unmarked_goes(tmp_path: Path) -> None:
    recorder = Recorder(Shelf(section(tmp_path, rotate_size=1, budget=4), Time()), lossless=True)
    bystander = tmp_path / "wedges.mcap"
    bystander.write_bytes(bytes(5_000_000))
    recorder.start()
    kept = recorder.keep()
    number = 0
    for _ in range(12):
        # A burst of 0.5 MB (hexadecimal noise halves when it is compressed).
        recorder.record([message(number, 1000, "camera/calibration")])
        for _ in range(5):
            number += 1
            recorder.record([message(number, 200_000)])
    last = recorder.stop()
    assert last.error is None
    assert last.dropped == 0
    files = sorted(path for path in tmp_path.glob("2*.mcap"))
    assert kept in files
    assert Path(last.file or "") in files
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
    recorder = Recorder(Shelf(section(tmp_path, rotate_size=1), Time()), lossless=True)
    recorder.start()
    for number in range(30):
        recorder.record([message(number, 200_000)])
    recorder.stop()
    files = sorted(tmp_path.glob("2*.mcap"))
    assert len(files) > 2
    assert max(path.stat().st_size for path in files) < 1_700_000
    assert [sequence for path in files for _, sequence, _ in read(path)] == list(range(30))


def test_kept_recordings_that_fill_the_budget_stop_the_recorder_and_say_so(tmp_path: Path) -> None:
    for day in (1, 2, 3):
        (tmp_path / f"2026010{day}T000000Z.mcap").write_bytes(bytes(1_000_000))
        (tmp_path / f"2026010{day}T000000Z.mcap.keep").touch()
    recorder = Recorder(Shelf(section(tmp_path, rotate_size=1, budget=3), Time()))
    with pytest.raises(OutputError, match=r"marked to keep .* 3 MB.*recording\.budget"):
        recorder.start()
    assert len(list(tmp_path.glob("*.mcap"))) == 3


def test_nothing_can_be_kept_before_something_was_recorded(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="start recording first"):
        Recorder(Shelf(section(tmp_path), Time())).keep()


class FullDisk(output.FileIO):
    """A file on a disk with room for 500 kB."""

    room = 500_000

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


def test_a_full_disk_ends_the_recording_keeps_what_was_written_and_holds_up_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "open_unbuffered", lambda path: FullDisk(path, "x+"))
    recorder = Recorder(SingleFile(tmp_path / "a.mcap"), lossless=True)
    path = recorder.start()
    for number in range(20):
        recorder.record([message(number, 200_000)])
    state = recorder.stop()
    assert not state.recording
    assert "the disk is full" in (state.error or "")
    assert 0 < state.messages < 20
    kept = read(path)
    assert [sequence for _, sequence, _ in kept] == list(range(len(kept)))
    assert 2 <= len(kept) <= state.messages
    monkeypatch.undo()
    path.rename(tmp_path / "b.mcap")
    recorder.start()
    recorder.record([message(99)])
    assert recorder.stop().error is None
    assert [sequence for _, sequence, _ in read(path)] == [99]


def test_a_full_queue_loses_the_oldest_and_counts_it() -> None:
    lost: list[str] = []
    box: Outbox[str] = Outbox(items=3, size=100, dropped=lost.append, droppable=lambda item: item != "report")
    for item in ("report", "a", "b", "c", "d"):
        box.put(item, 10)
    assert lost == ["a", "b"]
    box.put("large", 95)
    assert lost == ["a", "b", "c", "d", "report"]
    box.put("larger than all", 1000)
    assert box.get() == "larger than all"
    box.close()
    box.put("late", 1)
    assert box.get() is None
    assert lost == ["a", "b", "c", "d", "report", "large", "late"]


def test_a_lossless_queue_makes_the_producer_wait() -> None:
    lost: list[int] = []
    box: Outbox[int] = Outbox(items=2, size=1000, lossless=True, dropped=lost.append)
    producer = threading.Thread(target=lambda: [box.put(number, 1) for number in range(50)])
    producer.start()
    taken = [box.get() for _ in range(50)]
    producer.join()
    assert taken == list(range(50))
    assert lost == []
    assert not box.wait_empty(0.0)
    box.close()
    assert box.get() is None
    assert box.wait_empty(0.0)
