"""Recordings: the same frames come back, with all that goes with them."""

import struct
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from made_frames import FIELDS, PERIOD, START, assert_same_frame, make_frame
from made_recordings import chunks, flipped, write
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from drivers import RecordingError, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import CAMERA_CALIBRATION, calibration_message, frame_messages, image_message
from drivers.recording import Recording, RecordingWriter, attachments, open_recording


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
        scale=np.nextafter(1e-3, 1),
    )
    (back,) = open_recording(write(tmp_path / "x.mcap", [frame])).frames()
    assert_same_frame(back, frame)
    assert len(FIELDS) == 13  # a new field needs a value here


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
        writer.write(calibration_message(sr4000_calibration(), START), START)
        writer.write_frame(frames[0], Mount())
    found = open_recording(tmp_path / "x.mcap").calibration
    assert (found.intrinsics, found.shape) == (sr4000_calibration().intrinsics, (144, 176))
    assert found.distortion == sr4000_calibration().distortion
    assert found.source == f"message on {CAMERA_CALIBRATION}"


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
    still = [replace(make_frame(number, burst=0), pan=0.1, tilt=0.0) for number in (0, 1, 5)]
    lossy = open_recording(write(tmp_path / "lossy.mcap", still)).summary().frames
    assert (lossy.drops, lossy.passed) == (3, 0)
    turned = [still[0], still[1], replace(still[2], pan=0.101), make_frame(7, burst=1)]
    healthy = open_recording(write(tmp_path / "healthy.mcap", turned)).summary().frames
    assert (healthy.drops, healthy.passed) == (0, 4)
    offset, length = chunks(whole)[2]
    summary = Recording(flipped(whole, tmp_path, offset + length // 2)).summary()
    assert summary.damage_text.startswith("damaged chunk")
    assert summary.model_dump(mode="json")["damage"]["parts"][0]["offset"] == offset
