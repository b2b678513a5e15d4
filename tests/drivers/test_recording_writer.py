"""Writing recordings: whole or not there, and readable after a kill, a crash or a full disk."""

import errno
import io
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import zstandard
from made_frames import START, assert_same_frame, make_frame
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

import drivers.recording.output
from drivers import RecordingError, StateError, StorageError, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import calibration_message, image_message
from drivers.recording import (
    Compression,
    Recording,
    RecordingWriter,
    attachments,
    open_recording,
    recover,
    recovered_path,
)

ROOT = Path(__file__).parents[2]


def test_the_name_is_given_when_the_file_is_complete(tmp_path):
    path = tmp_path / "x.mcap"
    writer = RecordingWriter(path)
    writer.write_frame(make_frame(0), Mount())
    assert [file.name for file in tmp_path.iterdir()] == ["x.mcap.active"]
    writer.close()
    writer.close()
    assert [file.name for file in tmp_path.iterdir()] == ["x.mcap"]
    with pytest.raises(StateError, match="the recording is closed"):
        writer.write_frame(make_frame(1), Mount())


def write_frames(path, numbers, **options):
    with RecordingWriter(path, **options) as writer:
        for number in numbers:
            writer.write_frame(make_frame(number), Mount())


def test_an_exception_leaves_nothing_behind(tmp_path):
    def numbers():
        yield from range(5)
        raise KeyError

    with pytest.raises(KeyError):
        write_frames(tmp_path / "x.mcap", numbers())
    assert list(tmp_path.iterdir()) == []


def test_calibration_is_attached_once(tmp_path):
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write_calibration(sr4000_calibration(), START)
        writer.write_calibration(sr4000_calibration(), START + 1)
        writer.write_frame(make_frame(0), Mount())
    recording = Recording(tmp_path / "x.mcap")
    assert recording.topics["camera/calibration"].count == 2
    assert recording.path.read_bytes().count(b"distortion =") == 1
    assert recording.attachment(attachments.CALIBRATION) == sr4000_calibration().to_toml().encode()


def test_a_quickly_compressed_recording_is_larger_and_holds_the_same(tmp_path):
    frames = [make_frame(number) for number in range(20)]
    for compression in Compression:
        with RecordingWriter(tmp_path / f"{compression.name}.mcap", compression=compression) as writer:
            for frame in frames:
                writer.write_frame(frame, Mount())
    small, quick = (tmp_path / f"{compression.name}.mcap" for compression in Compression)
    assert small.stat().st_size < 0.95 * quick.stat().st_size
    for path in small, quick:
        read = list(open_recording(path).frames())
        assert [frame.sequence for frame in read] == [frame.sequence for frame in frames]
        assert all(np.array_equal(a.counts, b.counts) for a, b in zip(read, frames, strict=True))


def test_size_grows_with_what_is_in_the_file(tmp_path):
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        for number in range(12):
            writer.write_frame(make_frame(number), Mount())
            assert writer.size == (tmp_path / "x.mcap.active").stat().st_size
        assert writer.size > 600_000
        before = writer.size
        writer.write_frame(make_frame(12), Mount())
        writer.flush(sync=True)
        assert writer.size > before
        assert Recording(tmp_path / "x.mcap.active").frame_count == 13


def test_a_topic_has_one_schema(tmp_path):
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write(image_message("a", make_frame(0).counts, "16UC1"), START)
        other = calibration_message(sr4000_calibration(), START, topic="a")
        with pytest.raises(ValueError, match=r"topic a holds foxglove\.RawImage"):
            writer.write(other, START)


def test_frames_survive_a_kill_up_to_the_last_chunk(tmp_path):
    """The process writes frame by frame and is killed by its own id when 20 are written."""
    path = tmp_path / "killed.mcap"
    program = textwrap.dedent(
        f"""
        import sys
        sys.path[:0] = [{str(ROOT)!r}, {str(Path(__file__).parent)!r}]
        from made_frames import make_frame
        from drivers.calibration import Mount
        from drivers.recording import RecordingWriter
        writer = RecordingWriter({str(path)!r})
        for number in range(10_000):
            writer.write_frame(make_frame(number), Mount())
            print(number, flush=True)
            if number == 19:
                sys.stdin.read()
        """
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        for line in process.stdout:
            if line.strip() == "19":
                break
        os.kill(process.pid, signal.SIGKILL)
    recording = open_recording(tmp_path / "killed.mcap.active")
    assert 20 - 3 <= recording.frame_count <= 20
    for back, number in zip(recording.frames(), range(20), strict=False):
        assert_same_frame(back, make_frame(number))
    assert recording.damage.is_torn
    assert "the file ends here, without an index" in str(recording.damage)


def test_what_a_dead_process_left_is_kept_aside(tmp_path, caplog):
    path = tmp_path / "x.mcap"
    (tmp_path / "x.mcap.active").write_bytes(b"left")
    (tmp_path / "x.torn.mcap").write_bytes(b"left before")
    with RecordingWriter(path) as writer:
        writer.write_frame(make_frame(0), Mount())
    assert sorted(file.name for file in tmp_path.iterdir()) == ["x.mcap", "x.torn.mcap", "x.torn1.mcap"]
    assert (tmp_path / "x.torn1.mcap").read_bytes() == b"left"
    assert "was left unfinished; kept as" in caplog.text


def test_a_file_that_is_being_written_is_refused(tmp_path):
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write_frame(make_frame(0), Mount())
        with pytest.raises(StorageError, match=r"x\.mcap: cannot be written: another process is writing it"):
            RecordingWriter(tmp_path / "x.mcap")
    assert open_recording(tmp_path / "x.mcap").frame_count == 1


def test_a_missing_folder_is_told(tmp_path):
    with pytest.raises(StorageError, match=r"there is no folder .*: create it first"):
        RecordingWriter(tmp_path / "nowhere" / "x.mcap")


class FullDisk(io.FileIO):
    """A file on a disk with so many bytes left; short writes first, as the system does it."""

    def __init__(self, path, room):
        super().__init__(path, "x+")
        self.room = room

    def write(self, data):
        room = self.room - self.tell()
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(bytes(data[:room]))


@pytest.fixture
def full_disk(monkeypatch):
    def limit(room):
        monkeypatch.setattr(drivers.recording.output, "open_unbuffered", lambda path: FullDisk(path, room))

    return limit


def test_a_full_disk_raises_and_keeps_what_was_written(tmp_path, full_disk):
    full_disk(1_000_000)
    numbers = iter(range(100))
    with pytest.raises(StorageError, match=r"x\.mcap: cannot be written: the disk is full: free some space"):
        write_frames(tmp_path / "x.mcap", numbers)
    taken = next(numbers) - 1
    recording = open_recording(tmp_path / "x.mcap")
    assert taken - 4 <= recording.frame_count <= taken
    assert recording.frame_count >= 8
    for number, back in enumerate(recording.frames()):
        assert_same_frame(back, make_frame(number))
    assert recording.damage is None or not recording.damage.parts  # no more than a frame cut between chunks


def test_writing_goes_on_failing_after_the_first_failure(tmp_path, full_disk):
    full_disk(300_000)
    writer = RecordingWriter(tmp_path / "x.mcap")
    writer.write_frame(make_frame(0), Mount())
    writer.write_frame(make_frame(1), Mount())
    writer.flush()
    writer.write_frame(make_frame(2), Mount())
    writer.write_frame(make_frame(3), Mount())
    for _ in range(2):
        with pytest.raises(StorageError, match="disk is full"):
            writer.flush()
    writer.close()
    assert [frame.sequence for frame in open_recording(tmp_path / "x.mcap").frames()] == [100, 101]


def test_a_disk_that_is_full_only_at_the_end_is_told_too(tmp_path, full_disk):
    full_disk(100_000)
    writer = RecordingWriter(tmp_path / "x.mcap")
    writer.write_frame(make_frame(0), Mount())
    writer.flush()
    writer.write_frame(make_frame(1), Mount())  # held in memory
    with pytest.raises(StorageError, match="disk is full"):
        writer.close()
    assert [frame.sequence for frame in open_recording(tmp_path / "x.mcap").frames()] == [100]


@pytest.mark.parametrize(("room", "frames"), [(300_000, 100), (100_000, 2)], ids=["on the way", "at the end"])
def test_what_shall_be_whole_is_not_there_on_a_full_disk_and_replaces_nothing(
    tmp_path, full_disk, room, frames
):
    path = tmp_path / "x.mcap"
    path.write_bytes(b"made before")
    full_disk(room)
    with pytest.raises(StorageError, match="disk is full"):
        write_frames(path, range(frames), whole=True)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("x.mcap", b"made before")]


def test_a_disk_without_any_room_leaves_no_file(tmp_path, full_disk):
    full_disk(20)
    with pytest.raises(StorageError, match="disk is full"):
        RecordingWriter(tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []


def test_recover_makes_a_whole_file_of_a_torn_one(tmp_path):
    path = tmp_path / "x.mcap"
    with RecordingWriter(path, {"run_id": "r7"}) as writer:
        writer.write_calibration(sr4000_calibration(), START)
        writer.attach(attachments.CONFIGURATION, b"[fusion]", "application/toml")
        for number in range(10):
            writer.write_frame(make_frame(number), Mount(), log_time=START + 7 * number)
    torn = path.rename(tmp_path / "x.mcap.active")
    torn.write_bytes(torn.read_bytes()[:600_000])
    before = open_recording(torn)
    whole = recovered_path(torn)
    assert whole == tmp_path / "x.recovered.mcap"
    saved = recover(before, whole)
    after = open_recording(whole)
    assert after.damage is None
    assert 3 < after.frame_count == before.frame_count
    for number, back in enumerate(after.frames()):
        assert_same_frame(back, make_frame(number))
    assert after.calibration == sr4000_calibration()
    assert (after.configuration, after.metadata["run_id"]) == ("[fusion]", "r7")
    assert after.attachment(attachments.VERSIONS) == before.attachment(attachments.VERSIONS)
    assert saved == sum(entry.count for entry in after.topics.values())
    times = {log_time for message, log_time in after.messages() if message.topic == "camera/frame"}
    assert times == {START + 7 * number for number in range(after.frame_count)}


@pytest.mark.parametrize("share", [0, 0.0001, 0.5, 0.9999], ids=["none", "some bytes", "half", "nearly all"])
def test_a_recovery_on_a_full_disk_leaves_all_as_it_was(tmp_path, full_disk, share):
    torn = tmp_path / "x.mcap"
    write_frames(torn, range(10))
    torn.write_bytes(torn.read_bytes()[:600_000])
    made = tmp_path / "made before.mcap"
    recover(Recording(torn), made)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    full_disk(int(share * made.stat().st_size))
    for name in ("out.mcap", made.name):
        with pytest.raises(
            StorageError, match=rf"{name}: cannot be written: the disk is full: free some space"
        ):
            recover(Recording(torn), tmp_path / name)
        assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_what_shall_be_whole_is_not_there_where_the_disk_is_found_full_only_when_it_is_synced(
    tmp_path, monkeypatch
):
    """As file systems do that find room for what was written only later, those of a network among them."""

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    write_frames(tmp_path / "x.mcap", range(3))
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="disk is full"):
        recover(Recording(tmp_path / "x.mcap"), tmp_path / "out.mcap")
    with pytest.raises(StorageError, match="disk is full"):
        write_frames(tmp_path / "out.mcap", range(3), whole=True)
    assert [file.name for file in tmp_path.iterdir()] == ["x.mcap"]


def test_recover_refuses_what_holds_nothing_and_its_own_input(tmp_path):
    (tmp_path / "head.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(RecordingError, match="nothing can be recovered"):
        recover(Recording(tmp_path / "head.mcap"), tmp_path / "y.mcap")
    write_frames(tmp_path / "x.mcap", range(1))
    for name in ("x.mcap", "x.mcap.active"):
        (tmp_path / "x.mcap").rename(tmp_path / name)
        with pytest.raises(RecordingError, match="cannot be recovered in place"):
            recover(Recording(tmp_path / name), tmp_path / "x.mcap")
        assert Recording(tmp_path / name).frame_count == 1
    assert not (tmp_path / "y.mcap").exists()


def chunks(path):
    with path.open("rb") as file:
        return [one for one in StreamReader(file, emit_chunks=True).records if isinstance(one, Chunk)]


def test_chunks_are_compressed_fast_and_those_of_other_writers_as_ever(tmp_path):
    noise = np.random.default_rng(0).normal(2.0, 0.01, (200, 200)).astype(np.float32)
    message = image_message("camera/distance", noise, "32FC1", timestamp=START)
    with RecordingWriter(tmp_path / "ours.mcap") as writer:
        writer.write(message, START)
    with (tmp_path / "theirs.mcap").open("wb") as file:
        other = Writer(file)
        other.start()
        channel = other.register_channel("noise", "", other.register_schema("", "", b""))
        other.add_message(channel, START, message.payload, START)
        other.finish()
    for name, level in (("ours", 1), ("theirs", 3)):
        (chunk,) = chunks(tmp_path / f"{name}.mcap")
        raw = zstandard.decompress(chunk.data)
        assert chunk.data == zstandard.compress(raw, level)
        assert chunk.data != zstandard.compress(raw, 4 - level)
