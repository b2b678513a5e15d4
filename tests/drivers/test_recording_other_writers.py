"""Valid files of other writers: any order, chunking, compression and length of records."""

import json
import tracemalloc

import numpy as np
import pytest
import zstandard
from made_frames import assert_same_frame, make_bursts, make_frame
from made_recordings import flipped, write
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType
from other_writers import Parts, assemble, by_topic, chunk_bytes, encoded, padded, rewrite

from drivers import RecordingError, sr4000_calibration
from drivers.recording import Recording, open_recording

SMALL = (12, 16)


def small_calibration():
    return sr4000_calibration().model_copy(update={"width": SMALL[1], "height": SMALL[0]})


@pytest.fixture(scope="module")
def frames():
    return [
        make_frame(burst * 15 + pose, burst=burst, pose=pose, shape=SMALL)
        for burst in range(4)
        for pose in range(15)
    ]


@pytest.fixture(scope="module")
def source(frames, tmp_path_factory):
    return write(tmp_path_factory.mktemp("source") / "source.mcap", frames, small_calibration())


def assert_all_there(path, frames):
    recording = open_recording(path)
    assert recording.damage is None
    for back, frame in zip(recording.frames(), frames, strict=True):
        assert_same_frame(back, frame)
    assert [len(burst) for burst in recording.bursts(99)] == [15] * 4
    return recording


def test_sorted_by_topic(source, frames, tmp_path):
    recording = assert_all_there(rewrite(source, tmp_path / "x.mcap", by_topic), frames)
    assert recording.calibration == small_calibration()


def shuffled(found):
    return [found[k] for k in np.random.default_rng(3).permutation(len(found))]


def later_half_first(found):
    return found[len(found) // 2 :] + found[: len(found) // 2]


@pytest.mark.parametrize("order", [shuffled, later_half_first, lambda found: found[::-1]])
def test_any_order(source, frames, tmp_path, order):
    assert_all_there(rewrite(source, tmp_path / "x.mcap", order), frames)


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize(
    "options",
    [
        {"chunk_size": 1},
        {"chunk_size": 1 << 30},
        {"use_chunking": False},
        {"enable_crcs": False, "enable_data_crcs": True},
        {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False},
        {"repeat_channels": False, "repeat_schemas": False},
    ],
    ids=lambda options: "-".join(options),
)
def test_any_chunking_and_compression(source, frames, tmp_path, compression, options):
    path = rewrite(source, tmp_path / "x.mcap", by_topic, compression=compression, **options)
    assert_all_there(path, frames)


def test_records_longer_than_known(source, frames, tmp_path):
    recording = assert_all_there(padded(source, tmp_path / "x.mcap"), frames)
    assert recording.calibration == small_calibration()
    assert recording.metadata["rig"] == "bench"


def test_records_of_kinds_not_known_are_passed_over(source, frames, tmp_path):
    parts = Parts.of(source)
    strange = b"".join(
        bytes([kind]) + (5).to_bytes(8, "little") + b"hello" for kind in (0x10, 0x7F, 0x80, 0xFF)
    )
    inside = [encoded(record) for record in (*parts.definitions, *parts.messages)]
    path = assemble(tmp_path / "x.mcap", strange + chunk_bytes([*inside, strange]) + strange)
    recording = Recording(path)
    assert recording.frame_count == len(frames)
    assert "the index is missing" not in str(recording.damage)
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(path.read_bytes()[:-60])
    assert "records of kind 16 are not known here" in str(Recording(torn).damage)


def test_a_chunk_of_several_zstd_frames_is_read_whole(source, frames, tmp_path):
    parts = Parts.of(source)
    inside = [encoded(record) for record in (*parts.definitions, *parts.messages)]
    half = len(inside) // 2
    packed = b"".join(zstandard.compress(b"".join(part)) for part in (inside[:half], inside[half:]))
    for checksum in (True, False):
        path = assemble(tmp_path / "x.mcap", chunk_bytes(inside, packed=packed, checksum=checksum))
        assert Recording(path).frame_count == len(frames)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_without_checksum_that_is_cut_short_is_lost_and_told(source, frames, tmp_path, compression):
    parts = Parts.of(source)
    inside = [encoded(record) for record in (*parts.definitions, *parts.messages)]
    whole = chunk_bytes(inside, compression, checksum=False)
    assert Recording(assemble(tmp_path / "x.mcap", whole)).frame_count == len(frames)
    half = chunk_bytes(inside[: len(inside) // 2], compression, checksum=False, size=len(b"".join(inside)))
    path = assemble(
        tmp_path / "x.mcap", half + parts.indexes(), b"".join(encoded(record) for record in parts.definitions)
    )
    recording = Recording(path)
    assert recording.frame_count == 0
    assert "can be read" in recording.damage.parts[0].reason
    assert recording.damage.lost_messages["camera/frame"] == len(frames)


def test_messages_that_only_the_index_knows_are_lost_and_told(source, tmp_path):
    parts = Parts.of(source)
    inside = [encoded(record) for record in (*parts.definitions, *parts.messages[:-8])]
    path = assemble(tmp_path / "x.mcap", chunk_bytes(inside, checksum=False) + parts.indexes())
    assert sum(Recording(path).damage.lost_messages.values()) == 8
    known = b"".join(encoded(record) for record in (*parts.definitions, parts.statistics()))
    path = assemble(tmp_path / "y.mcap", chunk_bytes(inside), known)
    assert sum(Recording(path).damage.lost_messages.values()) == 8


@pytest.mark.parametrize(
    ("size", "said"),
    [(1 << 40, "more than the 268,435,456 that are read at once"), (1000, "it holds more")],
)
def test_a_chunk_that_holds_other_than_it_says_is_not_unpacked(tmp_path, size, said):
    bomb = chunk_bytes([], packed=zstandard.compress(bytes(200_000_000)), size=size)
    path = assemble(tmp_path / "x.mcap", bomb)
    tracemalloc.start()
    recording = Recording(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert said in str(recording.damage)
    assert peak < 20_000_000


def test_a_compression_that_is_not_known_is_told(tmp_path):
    path = assemble(tmp_path / "x.mcap", chunk_bytes([b"x"], "brotli", packed=b"x"))
    assert "compression 'brotli' cannot be read here; known are none, lz4 and zstd" in str(
        Recording(path).damage
    )


@pytest.mark.parametrize("kind", [Opcode.ATTACHMENT, Opcode.METADATA, Opcode.CHUNK, 0x90])
def test_a_record_that_promises_more_than_there_is_ends_the_file(source, frames, tmp_path, kind):
    content = source.read_bytes()
    parts = Parts.of(source)
    inside = chunk_bytes([encoded(record) for record in (*parts.definitions, *parts.messages)])
    path = tmp_path / "x.mcap"
    path.write_bytes(content[:8] + inside + bytes([kind]) + (1 << 60).to_bytes(8, "little") + b"short")
    recording = Recording(path)
    assert recording.frame_count == len(frames)
    assert recording.damage.is_torn
    assert "should have 1,152,921,504,606,846,976 bytes" in str(recording.damage)


def test_a_large_attachment_costs_no_memory(source, frames, tmp_path):
    path = tmp_path / "x.mcap"
    content, size = source.read_bytes(), (1 << 28) + 1
    head = (0).to_bytes(16, "little") + (4).to_bytes(4, "little") + b"huge" + (0).to_bytes(4, "little")
    with path.open("wb") as file:
        file.write(content[:8] + bytes([Opcode.ATTACHMENT]) + (len(head) + 12 + size).to_bytes(8, "little"))
        file.write(head + size.to_bytes(8, "little"))
        file.seek(size + 4, 1)  # a hole: nothing is written; no checksum
        file.write(content[8:])
    tracemalloc.start()
    recording = Recording(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert recording.frame_count == len(frames)
    assert recording.attachments["huge"].size == size
    assert peak < 20_000_000
    with pytest.raises(RecordingError, match="huge has 268,435,457 bytes; expected at most"):
        recording.attachment("huge")


def jumping(found):
    """The camera's counter runs ahead by 10⁸ from the eighth frame on."""
    later = sorted(
        {message.publish_time for _, channel, message in found if channel.topic == "/camera/frame"}
    )[8]
    for _, channel, message in found:
        if message.publish_time >= later:
            message.sequence += 10**8
            if channel.topic == "/camera/frame":
                said = json.loads(message.data)
                message.data = json.dumps(said | {"sequence": said["sequence"] + 10**8}).encode()
    return found


def test_a_counter_that_jumps_costs_no_memory(source, tmp_path):
    path = rewrite(source, tmp_path / "x.mcap", jumping, chunk_size=10_000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    tracemalloc.start()
    recording = open_recording(path)
    said = str(recording.damage)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000_000
    assert 30 < recording.frame_count < 60
    assert recording.damage.lost_frames == ()  # nothing is missing there: the camera counted on
    assert "torn at byte" in said
    assert [len(burst) for burst in recording.bursts(15)][:2] == [15, 15]


def test_a_jump_over_damage_is_said_as_a_range(source, tmp_path):
    path = rewrite(source, tmp_path / "x.mcap", jumping, chunk_size=4_000)
    entries = Recording(path).entries
    offset = entries[8].said.chunk
    lost = [entry for entry in entries if {place.chunk for place in entry.places} == {offset}]
    recording = open_recording(flipped(path, tmp_path, offset + 500))
    assert lost[0].sequence < 200 < 10**8 < lost[-1].sequence
    (gap,) = recording.damage.lost_frames
    assert gap.first <= lost[0].sequence
    assert gap.last >= lost[-1].sequence
    missing = len(entries) - recording.frame_count - len(recording.damage.incomplete_frames)
    assert f"missing frames: {missing} of {gap.first}-{gap.last}" in str(recording.damage)


def test_images_are_fetched_when_asked_for(tmp_path):
    """Opening a recording and going through it holds a few chunks, not the file."""
    frames = make_bursts(8, 15)
    path = write(tmp_path / "x.mcap", frames)
    assert path.stat().st_size > 9_000_000
    tracemalloc.start()
    recording = Recording(path)
    opened, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert opened < 1_500_000
    assert peak < 5_000_000
    assert recording.frame_count == 120


def test_a_file_that_changed_after_it_was_opened_is_told(source, tmp_path):
    path = tmp_path / "x.mcap"
    path.write_bytes(source.read_bytes())
    recording = Recording(path)
    path.write_bytes(b"x" * 1000)
    with pytest.raises(RecordingError, match="has changed since it was opened; open it again"):
        list(recording.frames())
    path.unlink()
    with pytest.raises(RecordingError, match="No such file"):
        list(recording.frames())
