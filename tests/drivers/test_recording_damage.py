"""Recordings that are torn or altered: what is left is read, and what is lost is told."""

import numpy as np
import pytest
from made_frames import assert_same_frame, make_bursts
from made_recordings import chunks, flipped, write

from drivers import sr4000_calibration
from drivers.recording import Recording, attachments, open_recording


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
    lost = {number for gap in damage.lost_frames for number in range(gap.first, gap.last + 1)}
    assert lost | set(damage.incomplete_frames) == missing
    assert lost.isdisjoint(damage.incomplete_frames)
    assert damage.lost_frame_count == len(lost)
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
