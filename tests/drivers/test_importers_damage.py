"""Damaged camera files of every kind: frames, or one line that says what is wrong; and little memory."""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_imports import (
    Scene,
    raw_images,
    srs_camera,
    srs_frame,
    srs_object,
    srs_registers,
    text,
    write_bdat,
    write_depth,
    write_srs,
)

from drivers import RecordingError
from drivers.importers import ImportOptions, import_frames

OPTIONS = ImportOptions(accept_inferred=True, frame_rate=10)
SRS_FRAMES = raw_images(3)
KINDS = ("a.dat", "a.bdat", "b.bdat", "a.srs")

quick = settings(
    max_examples=10,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.data_too_large],
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The content of one good file of each kind."""
    folder, scene = tmp_path_factory.mktemp("whole"), Scene()
    objects = [srs_camera(), srs_registers(), srs_object(4, b"<xml/>"), *map(srs_frame, SRS_FRAMES)]
    write_bdat(folder / "a.bdat", scene)
    write_depth(folder / "b.bdat", scene)
    write_srs(folder / "a.srs", objects)
    (folder / "a.dat").write_text(text(scene))
    return {name: (folder / name).read_bytes() for name in KINDS}


@pytest.fixture(scope="module")
def right(whole, tmp_path_factory):
    """The frames of each good file."""
    folder = tmp_path_factory.mktemp("right")
    return {name: imported(folder / name, content)[0] for name, content in whole.items()}


def imported(path: Path, content: bytes):
    """The frames and what was lost, or the one line that says why there are none."""
    path.write_bytes(content)
    try:
        found = import_frames([path], OPTIONS)
        return list(found.frames()), found.findings.lost
    except RecordingError as error:
        said = str(error)
    assert "\n" not in said
    assert len(said) < 600
    assert path.name in said
    return None, []


def damage(content: bytes, data: st.DataObject) -> bytes:
    """`content` with some of its bytes changed, lost or doubled."""
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content)))
        length = data.draw(st.sampled_from([1, 2, 8, 1000, 200_000]))
        patch = data.draw(
            st.one_of(
                st.binary(max_size=12), st.sampled_from([b"", b"nan\t", b"1e999 ", content[at : at + length]])
            )
        )
        content = content[:at] + patch + content[at + data.draw(st.sampled_from([0, length])) :]
    return content


@pytest.mark.parametrize("kind", KINDS)
@quick
@given(data=st.data())
def test_any_damage_gives_frames_or_one_line(whole, tmp_path, kind, data):
    frames, _ = imported(tmp_path / kind, damage(whole[kind], data))
    for frame in frames or ():
        assert frame.shape == (144, 176)


@pytest.mark.parametrize("kind", KINDS)
@quick
@given(content=st.binary(max_size=300), marks=st.sampled_from([b"", b"srIO\1\0\0\0", b"% z\n", b"\xff\xfe"]))
def test_garbage_gives_one_line(tmp_path, kind, content, marks):
    frames, _ = imported(tmp_path / kind, marks + content)
    assert not frames


@pytest.mark.parametrize("kind", KINDS)
@quick
@given(part=st.floats(0, 1))
def test_what_is_cut_off_is_missed_or_refused(whole, right, tmp_path, kind, part):
    content = whole[kind][: int(part * len(whole[kind]))]
    frames, lost = imported(tmp_path / kind, content)
    for frame, other in zip(frames or (), right[kind], strict=False):
        np.testing.assert_array_equal(frame.counts[frame.counts != 0], other.counts[frame.counts != 0])
        np.testing.assert_array_equal(frame.amplitude, other.amplitude)
        assert frame.timestamp in (other.timestamp, 0)
    assert frames is None or lost or len(frames) == len(right[kind]) or kind == "a.srs"


@quick
@given(frames=st.integers(0, 3), cut=st.integers(1, 101_383))
def test_a_cut_stream_keeps_its_whole_frames_and_says_the_rest(whole, tmp_path, frames, cut):
    size = 8 + SRS_FRAMES[0].nbytes
    head = len(whole["a.srs"]) - 3 * size
    end = min(head + frames * size + cut, len(whole["a.srs"]) - 1)
    kept, lost = imported(tmp_path / "a.srs", whole["a.srs"][:end])
    assert len(kept) == min(frames, 2)
    for frame, (counts, amplitude) in zip(kept, SRS_FRAMES, strict=False):
        np.testing.assert_array_equal(frame.counts, counts)
        np.testing.assert_array_equal(frame.amplitude, amplitude)
    assert len(lost) == 1


@quick
@given(lost=st.integers(0, 143), doubled=st.integers(1, 143))
def test_rows_in_the_place_of_others_give_no_wrong_distance(whole, right, tmp_path, lost, doubled):
    lines = whole["a.dat"].decode().splitlines(keepends=True)
    y = lines[291 : 291 + 144]
    del y[lost]
    y.insert(doubled, y[doubled - 1])
    frames, _ = imported(tmp_path / "a.dat", "".join([*lines[:291], *y, *lines[435:]]).encode())
    (expected,) = right["a.dat"]
    for frame in frames or ():
        told = frame.counts != 0
        error = frame.counts[told].astype(float) - expected.counts[told]
        assert np.abs(error).max() * 5 / 65536 < 0.004  # metres; half a pixel aside can hide as much


@pytest.mark.parametrize("kind", [0x8000_0001, 1, 3, 4])
def test_a_header_that_promises_gigabytes_takes_no_memory(tmp_path, kind):
    path = tmp_path / "a.srs"
    write_srs(path, [srs_camera(), srs_registers(), struct.pack("<II", kind, 0xFFFF_FFFF)])
    tracemalloc.start()
    imported_whole = _refused_or_empty(path)
    with path.open("r+b") as file:
        file.truncate(5 << 30)
    _refused_or_empty(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert imported_whole
    assert peak < 16 << 20


def _refused_or_empty(path):
    try:
        found = import_frames([path], OPTIONS)
        return not list(found.frames()) and bool(found.findings.lost)
    except RecordingError:
        return True
