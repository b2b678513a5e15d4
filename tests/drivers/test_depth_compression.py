"""Compressed depth: PNG with a header, inverse depth, RVL."""

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.depth.compressed import decompressed
from drivers.errors import RecordingError

HEADER = struct.pack("<iff", 0, 0.0, 0.0)


def png(array):
    return cv2.imencode(".png", array)[1].tobytes()


def image():
    found = np.random.default_rng(0).integers(500, 4000, (30, 40)).astype(np.uint16)
    found[3, :20] = 0
    return found


def rvl(array):
    """Encoder after the paper, one number at a time."""
    groups, flat, place, last = [], array.ravel().astype(int).tolist(), 0, 0

    def number(value):
        while True:
            group, value = value & 7, value >> 3
            groups.append(group | (8 if value else 0))
            if not value:
                return

    while place < len(flat):
        start = place
        while place < len(flat) and flat[place] == 0:
            place += 1
        number(place - start)
        start = place
        while place < len(flat) and flat[place]:
            place += 1
        number(place - start)
        for value in flat[start:place]:
            delta, last = value - last, value
            number((delta << 1) ^ (delta >> 31))
    groups += [0] * (-len(groups) % 8)
    words = np.array(groups, np.uint32).reshape(-1, 8) << np.arange(28, -4, -4, dtype=np.uint32)
    sizes = struct.pack("<ii", array.shape[1], array.shape[0])
    return sizes + np.bitwise_or.reduce(words, axis=1).astype("<u4").tobytes()


@pytest.mark.parametrize("told", ["16UC1; compressedDepth png", "16UC1; compressedDepth"])
def test_whole_numbers_come_back(told):
    np.testing.assert_array_equal(decompressed(told, HEADER + png(image())), image())


def test_plain_pictures_come_back():
    for told in ("png", "16UC1; png compressed "):
        np.testing.assert_array_equal(decompressed(told, png(image())), image())
    tiff = cv2.imencode(".tiff", image())[1].tobytes()
    np.testing.assert_array_equal(decompressed("tiff", tiff), image())


def test_metres_come_back_as_far_as_they_were_stored():
    scale, offset = 100 * 101.0, 1 - 101.0  # depth_quantization 100, depth_max 10 m, as the plugin makes them
    scale, offset = 100.0 * (100.0 + 1.0), 1.0 - scale / 10.0
    depth = np.linspace(1.0, 9.0, 200).reshape(10, 20)
    stored = np.rint(scale / depth + offset).astype(np.uint16)
    stored[0, 0] = 0
    back = decompressed("32FC1; compressedDepth png", struct.pack("<iff", 0, scale, offset) + png(stored))
    assert back.dtype == np.float32
    assert np.isnan(back[0, 0])
    np.testing.assert_allclose(back.ravel()[1:], depth.ravel()[1:], rtol=5e-3)


@settings(max_examples=40)
@given(
    arrays(
        np.uint16,
        st.tuples(st.integers(1, 9), st.integers(1, 11)),
        elements=st.one_of(st.just(0), st.integers(0, 0xFFFF), st.integers(990, 1010)),
    )
)
def test_rvl_comes_back(array):
    np.testing.assert_array_equal(decompressed("16UC1; compressedDepth rvl", HEADER + rvl(array)), array)


@settings(max_examples=30)
@given(st.binary(max_size=64))
def test_garbage_is_one_line(garbage):
    whole = HEADER + rvl(image())
    for told in ("16UC1; compressedDepth rvl", "16UC1; compressedDepth png", "png"):
        for content in (garbage, HEADER + garbage, whole[: len(garbage) * 8]):
            with pytest.raises(RecordingError):
                decompressed(told, content)


def test_an_unknown_compression_is_named():
    with pytest.raises(RecordingError, match=r"'h264'.*known are png"):
        decompressed("h264", b"x" * 40)


def test_colour_is_no_depth():
    with pytest.raises(RecordingError, match="3 channels"):
        decompressed("png", png(np.zeros((4, 5, 3), np.uint8)))
