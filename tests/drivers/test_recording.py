"""Recordings: the same frames come back, and damage is passed and told."""

import struct
from io import BytesIO

import numpy as np
import pytest
from made_frames import FIELDS, PERIOD, START, assert_same_frame, make_bursts, make_frame
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from drivers import RecordingError, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import CAMERA_CALIBRATION, frame_messages, image_message
from drivers.recording import Recording, RecordingWriter, attachments, open_recording


def write(path, frames, calibration=None, metadata=None):
    with RecordingWriter(path, metadata or {"rig": "bench", "run_id": "r1"}) as writer:
        if calibration is not None:
            writer.write_calibration(calibration, frames[0].timestamp)
        for frame in frames:
            writer.write_frame(frame, Mount(), log_time=frame.timestamp + 5_000_000)
    return path


@pytest.fixture(scope="module")
def frames():
    return make_bursts(2, 15)


@pytest.fixture(scope="module")
def whole(frames, tmp_path_factory):
    return write(tmp_path_factory.mktemp("recording") / "whole.mcap", frames, sr4000_calibration())


def chunks(path):
    """(offset, length) of each chunk record."""
    with path.open("rb") as file:
        return [
            (at.chunk_start_offset, at.chunk_length) for at in make_reader(file).get_summary().chunk_indexes
        ]


def test_frames_come_back_bit_for_bit(whole, frames):
    recording = open_recording(whole)
    got = list(recording.frames())
    assert len(got) == recording.frame_count == 30
    for back, frame in zip(got, frames, strict=True):
        assert_same_frame(back, frame)
    assert recording.damage is None
    assert len(list(recording.frames())) == 30  # a second reading starts anew


def test_extreme_values_of_every_field_come_back(tmp_path):
    frame = make_frame(
        0,
        counts=np.array([[0, 1], [65534, 65535]], np.uint16),
        amplitude=np.array([[65535, 0], [1, 2]], np.uint16),
        timestamp=2**63 - 1_000_000_000,
        sequence=2**40 + 3,
        pan=np.nextafter(0.1, 1),
        tilt=-5e-324,
        integration_time=None,
        modulation_frequency=29.000001e6,
        ambiguity_range=1.5e8 / 29.000001e6,
        amplitude_mode="gray",
        timestamp_uncertainty=2**62,
        saturation_level=0x8000,
        burst=None,
        pose=None,
    )
    (back,) = open_recording(write(tmp_path / "x.mcap", [frame])).frames()
    assert_same_frame(back, frame)
    assert len(FIELDS) == 12  # a new field needs a value here


def test_times_mean_what_they_should(whole, frames):
    with whole.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.topic != "/camera/calibration":
                number = (message.publish_time - START) // PERIOD
                assert message.publish_time == frames[number].timestamp
                assert message.log_time == message.publish_time + 5_000_000
                assert message.sequence == frames[number].sequence


def test_recording_says_what_it_is(whole):
    recording = open_recording(whole)
    assert recording.metadata["rig"] == "bench"
    assert recording.metadata["run_id"] == "r1"
    assert recording.metadata["software_version"]
    assert recording.calibration == sr4000_calibration()
    assert (recording.configuration, recording.truth) == (None, None)
    assert set(recording.attachments) == {attachments.CALIBRATION, attachments.VERSIONS}


def test_configuration_and_truth_are_attached(tmp_path, frames):
    truth = np.linspace(1, 2, 12, dtype=np.float32).reshape(3, 4)
    packed = BytesIO()
    np.savez_compressed(packed, distance=truth)
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.attach(attachments.CONFIGURATION, b"[fusion]\n", "application/toml")
        writer.attach(attachments.TRUTH, packed.getvalue(), "application/x-npz")
        writer.write_frame(frames[0], Mount())
    recording = open_recording(tmp_path / "x.mcap")
    assert recording.configuration == "[fusion]\n"
    np.testing.assert_array_equal(recording.truth, truth)


def test_bursts_follow_ids_else_are_cut(tmp_path, whole):
    assert [len(burst) for burst in open_recording(whole).bursts(4)] == [15, 15]
    plain = write(tmp_path / "plain.mcap", [make_frame(number) for number in range(7)])
    assert [len(burst) for burst in open_recording(plain).bursts(3)] == [3, 3, 1]
    with pytest.raises(ValueError, match="at least 1"):
        next(open_recording(plain).bursts(0))


def test_messages_come_back_as_they_were_written(tmp_path):
    message = image_message("fused/depth", np.ones((4, 6), np.float32), "32FC1", timestamp=START, sequence=9)
    with RecordingWriter(tmp_path / "fused.mcap") as writer:
        writer.write(message, START + 7)
    recording = Recording(tmp_path / "fused.mcap")
    assert list(recording.messages(["fused/depth"])) == [(message, START + 7)]
    assert list(recording.messages(["fused/points"])) == []
    with pytest.raises(RecordingError, match="holds no whole frame; expected camera/distance"):
        open_recording(recording.path)


def test_calibration_message_serves_where_nothing_is_attached(tmp_path, frames):
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer._attached.add(attachments.CALIBRATION)
        writer.write_calibration(sr4000_calibration(), START)
        writer.write_frame(frames[0], Mount())
    found = open_recording(tmp_path / "x.mcap").calibration
    assert (found.intrinsics, found.shape) == (sr4000_calibration().intrinsics, (144, 176))
    assert found.distortion == sr4000_calibration().distortion
    assert found.source == f"message on {CAMERA_CALIBRATION}"


def test_a_torn_file_says_what_its_only_burst_lacks(tmp_path):
    for metadata, said in (
        ({"run_id": "r"}, "burst 0 has {} frames, perhaps not all"),
        ({attachments.FRAMES_PER_BURST: "15"}, "burst 0 has {} of 15 frames"),
    ):
        path = write(tmp_path / "x.mcap", make_bursts(1, 15), metadata=metadata)
        path.write_bytes(path.read_bytes()[:700_000])
        recording = open_recording(path)
        assert 3 < recording.frame_count < 10
        assert said.format(recording.frame_count) in str(recording.damage)


def test_torn_file_is_read_up_to_its_last_whole_chunk(whole, frames, tmp_path):
    content = whole.read_bytes()
    offsets = chunks(whole)
    offset, length = offsets[3]
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(content[: offset + length // 2])
    recording = open_recording(torn)
    got = list(recording.frames())
    assert 7 <= len(got) < 12  # three chunks of 2 to 3 frames
    for back, frame in zip(got, frames, strict=False):
        assert_same_frame(back, frame)
    damage = recording.damage
    assert damage.is_torn
    assert damage.unreadable_bytes == length // 2
    assert damage.parts[0].offset == offset
    assert damage.last_frame == got[-1].sequence
    assert damage.short_bursts[0].frames == len(got)
    said = str(damage)
    assert f"torn at byte {offset:,}" in said
    assert f"{length // 2:,} bytes unusable" in said
    assert f"all up to frame {got[-1].sequence} can be read" in said
    assert recording.calibration == sr4000_calibration()  # written first


@pytest.mark.parametrize("kept", [1.0, 0.97, 0.7, 0.31, 0.05, 0.003])
def test_torn_anywhere_gives_a_prefix_of_the_frames(whole, frames, tmp_path, kept):
    content = whole.read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(content[: int(len(content) * kept) - 1])
    recording = Recording(torn)
    assert recording.damage is not None
    got = [frame.sequence for frame in recording.frames()]
    assert got == [frame.sequence for frame in frames][: len(got)]
    if kept == 1.0:
        assert len(got) == 30  # the index alone is hurt


def flipped(whole, tmp_path, position):
    content = bytearray(whole.read_bytes())
    content[position] ^= 0x10
    path = tmp_path / "flipped.mcap"
    path.write_bytes(content)
    return path


def test_damaged_chunk_is_passed_over(whole, frames, tmp_path):
    offset, length = chunks(whole)[2]
    recording = open_recording(flipped(whole, tmp_path, offset + length // 2))
    got = list(recording.frames())
    assert 26 <= len(got) <= 28
    by_sequence = {frame.sequence: frame for frame in frames}
    for back in got:
        assert_same_frame(back, by_sequence[back.sequence])
    assert got[-1].sequence == frames[-1].sequence
    damage = recording.damage
    assert not damage.is_torn
    missing = set(by_sequence) - {frame.sequence for frame in got}
    assert {*damage.lost_frames, *damage.incomplete_frames} == missing
    assert damage.lost_messages["camera/frame"] in (2, 3)
    assert damage.short_bursts[0].frames == 15 - len(missing)
    assert f"damaged chunk of {length:,} bytes at byte {offset:,}" in str(damage)
    assert len(next(iter(recording.bursts(15)))) == 15 - len(missing)


def test_damaged_first_chunk_does_not_take_the_schemas_along(whole, tmp_path):
    offset, length = chunks(whole)[0]
    recording = open_recording(flipped(whole, tmp_path, offset + length - 100))
    assert 26 <= recording.frame_count <= 28
    assert recording.damage.lost_messages["camera/calibration"] == 1


def test_garbled_record_length_is_passed_over_with_the_index(whole, tmp_path):
    offset, _ = chunks(whole)[2]
    recording = open_recording(flipped(whole, tmp_path, offset + 8))  # the length's highest byte
    assert 26 <= recording.frame_count <= 28
    assert recording.damage.parts[0].reason == "its record header is garbled"


def test_damaged_attachment_is_told_and_frames_remain(whole, tmp_path):
    position = whole.read_bytes().index(b"[intrinsics]")
    recording = Recording(flipped(whole, tmp_path, position))
    assert recording.frame_count == 30
    assert "checksum of 'calibration.toml' does not match" in str(recording.damage)
    assert recording.calibration.source.startswith("message on")


def test_changed_metadata_is_noticed(whole, tmp_path):
    position = whole.read_bytes().index(b"bench")
    assert "has changed" in str(Recording(flipped(whole, tmp_path, position)).damage)


def test_damaged_index_leaves_all_frames(whole, tmp_path):
    recording = open_recording(flipped(whole, tmp_path, whole.stat().st_size - 30))
    assert recording.frame_count == 30
    assert "the index is missing or damaged" in str(recording.damage)


@pytest.mark.parametrize("bit", range(8))
def test_flipped_kind_of_record_does_not_end_the_file_unnoticed(whole, tmp_path, bit):
    for offset, length in (chunks(whole)[1], chunks(whole)[-1]):
        for position in (offset, offset + length):  # the chunk, and its first message index
            content = bytearray(whole.read_bytes())
            content[position] ^= 1 << bit
            (tmp_path / "x.mcap").write_bytes(content)
            recording = open_recording(tmp_path / "x.mcap")
            assert recording.damage is not None
            assert recording.frame_count >= 26


def test_any_single_flipped_byte_is_noticed_or_harmless(whole, frames, tmp_path):
    """No flip makes the reader fail or give a frame that was not recorded."""
    by_sequence = {frame.sequence: frame for frame in frames}
    random = np.random.default_rng(5)
    for position in random.integers(8, whole.stat().st_size, 25):
        recording = Recording(flipped(whole, tmp_path, position))
        assert recording.damage is not None
        for back in recording.frames():
            assert_same_frame(back, by_sequence[back.sequence])


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
        RecordingError, match="calibration is for 144 × 176 pixels, its frames have 124 × 160"
    ):
        open_recording(tmp_path / "x.mcap")


def test_images_that_do_not_fit_each_other_are_refused(tmp_path):
    frame = make_frame(0)
    small = make_frame(0, shape=(10, 10))
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        messages = frame_messages(frame, Mount())
        for message in (frame_messages(small, Mount())[0], *messages[1:]):
            writer.write(message, START)
    with pytest.raises(RecordingError, match=r"x\.mcap: images of frame 100 do not fit"):
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


def test_files_of_other_writers_are_read(tmp_path, frames):
    """Uncompressed, without chunks, without checksums."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=False, enable_crcs=False)
        writer.start()
        channels = {}
        for frame in frames[:4]:
            for message in frame_messages(frame, Mount()):
                if message.topic not in channels:
                    schema = writer.register_schema(
                        message.schema.name, message.schema.encoding, message.schema.data
                    )
                    channels[message.topic] = writer.register_channel(
                        "/" + message.topic, message.message_encoding, schema
                    )
                writer.add_message(
                    channels[message.topic], START, message.payload, message.publish_time, message.sequence
                )
        writer.finish()
    recording = open_recording(path)
    assert recording.damage is None
    for back, frame in zip(recording.frames(), frames[:4], strict=True):
        assert_same_frame(back, frame)


def test_chunks_are_small_and_compressed(whole):
    with whole.open("rb") as file:
        found = [
            record for record in StreamReader(file, emit_chunks=True).records if isinstance(record, Chunk)
        ]
    assert {chunk.compression for chunk in found} == {"zstd"}
    assert max(chunk.uncompressed_size for chunk in found) < 360_000  # at most one frame over 256 KiB
    assert struct.unpack("<8B", whole.read_bytes()[-8:])[0] == 0x89


def test_summary_has_the_figures(whole):
    summary = open_recording(whole).summary()
    assert summary.size == whole.stat().st_size
    frames = summary.frames
    assert (frames.count, frames.shape, frames.drops) == (30, (144, 176), 0)
    assert frames.rate == pytest.approx(50)
    assert frames.duration == pytest.approx(0.58)
    assert frames.integration_times == [0.003]
    assert [(burst.burst, burst.frames) for burst in frames.bursts] == [(0, 15), (1, 15)]
    assert frames.bursts[0].pan == pytest.approx((0, np.degrees(0.014)))
    assert {topic.topic: topic.messages for topic in summary.topics}["camera/distance"] == 30
    assert (summary.damage, summary.problem) == (None, None)


def test_summary_counts_drops_and_tells_damage(tmp_path, whole):
    lossy = write(tmp_path / "lossy.mcap", [make_frame(number) for number in (0, 1, 5)])
    assert open_recording(lossy).summary().frames.drops == 3
    offset, length = chunks(whole)[2]
    summary = Recording(flipped(whole, tmp_path, offset + length // 2)).summary()
    assert summary.damage_text.startswith("damaged chunk")
    assert summary.model_dump(mode="json")["damage"]["parts"][0]["offset"] == offset
