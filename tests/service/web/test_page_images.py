"""Images on their way to a browser: what it computes is what the rig measured, within half a step."""

import cv2
import numpy as np
import pytest
from browsing import Image, image_of

from service.messages.decoding import Received
from service.web.images import Picture
from service.web.thumbnails import Thumbnails, drawn

MATRIX = np.array([[200.0, 0, 43.5], [0, 200.0, 31.5], [0, 0, 1]])
LENS = np.array([-0.2, 0.05, 0.001, -0.001, 0.0])


def shown(topic: str, value: np.ndarray, *, compressed: bool = False, **told: object) -> Image:
    received = Received(topic, value, 1_700_000_000_500_000_000, **told)  # type: ignore[arg-type]
    return image_of(Picture(topic, received, 3, 1.5, ambiguity_range=7.5).frame(compressed=compressed))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_map_keeps_its_values_and_its_holes(compressed: bool) -> None:
    depth = np.random.default_rng(1).uniform(0.5, 6.0, (64, 88)).astype(np.float32)
    depth[:20, :30] = np.nan
    depth[0, 50] = np.inf
    image = shown("fused/depth", depth, compressed=compressed, intrinsics=MATRIX, distortion=LENS)
    np.testing.assert_allclose(image.values, np.where(np.isfinite(depth), depth, np.nan), atol=5e-5)
    header = image.header
    assert header["unit"] == "m"
    assert header["time"] == 1_700_000_000.5
    assert header["known"] == pytest.approx(1 - 601 / depth.size)
    assert header["low"] == pytest.approx(np.nanpercentile(depth[depth < 9], 2), abs=0.05)
    assert header["high"] == pytest.approx(np.nanpercentile(depth[depth < 9], 98), abs=0.05)
    assert header["intrinsics"] == MATRIX.ravel().tolist()
    assert header["distortion"] == LENS.tolist()


@pytest.mark.parametrize("value", [np.nan, 0.0, 2.5, -1e-3, 3e7])
def test_one_value_or_none_at_all_can_be_shown(value: float) -> None:
    image = shown("fused/deviation", np.full((6, 9), value, np.float32))
    np.testing.assert_allclose(image.values, np.full((6, 9), value), rtol=1e-5, atol=1e-7)
    assert image.header["known"] == (0.0 if np.isnan(value) else 1.0)


def test_raw_frames_keep_their_counts() -> None:
    counts = np.arange(0, 65536, 7, dtype=np.uint16)[:9360].reshape(90, 104)
    distance = shown("camera/distance", counts)
    expected = np.where(counts == 0, np.nan, counts * 7.5 / 65536)
    np.testing.assert_allclose(distance.values, expected, rtol=1e-12)
    amplitude = shown("camera/amplitude", counts)
    np.testing.assert_array_equal(amplitude.values, counts)  # a dark pixel is 0, not unknown
    assert amplitude.header["unit"] == "counts"


def test_the_depth_of_a_frame_is_its_distance_along_the_axis() -> None:
    counts = np.full((64, 88), 20_000, np.uint16)
    counts[5, 5] = 0
    depth = shown("camera/depth", counts, intrinsics=MATRIX, distortion=LENS).values
    pixel = np.array([[[80.0, 10.0]]])
    x, y = cv2.undistortPoints(pixel, MATRIX, LENS).ravel()
    assert depth[10, 80] == pytest.approx(20_000 * 7.5 / 65536 / np.sqrt(1 + x * x + y * y), abs=1e-4)
    assert np.isnan(depth[5, 5])


def test_thumbnails_join_maps_and_reports_in_any_order_and_only_the_last_stay() -> None:
    thumbnails = Thumbnails()
    assert thumbnails.add_report(1, {"burst": 1}) is None
    made = thumbnails.add_picture(1, b"png", (4, 6))
    assert made is not None
    assert made.told()["url"] == "/bursts/1.png"
    for number in range(2, 20):
        assert thumbnails.add_picture(number, b"png", (4, 6)) is None
        assert thumbnails.add_report(number, {"burst": number}) is not None
    assert [t.report["burst"] for t in thumbnails.newest_first] == list(range(19, 7, -1))
    assert thumbnails.picture("1") is None
    assert thumbnails.picture("19") == b"png"


def test_a_thumbnail_is_small_and_clear_where_nothing_is_known() -> None:
    depth = np.full((576, 704), 2.0, np.float32)
    depth[:, 352:] = 3.0
    depth[:80] = np.nan
    picture = cv2.imdecode(np.frombuffer(drawn(depth), np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (144, 176, 4)
    assert (picture[:20, :, 3] == 0).all()
    near, far = picture[100, 40].astype(int), picture[100, 140].astype(int)
    assert near[2] > near[0]  # red
    assert far[0] > far[2]  # blue
    assert drawn(np.full((5, 7), np.nan, np.float32))
