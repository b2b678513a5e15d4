"""Pictures of a burst: what they show, and that they are written whole."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers import sr3000_calibration
from service.config.sections import FusionSection
from service.errors import OutputError
from service.fusion.fuse import fuse_burst
from service.messages.burst import Burst
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.messages.quality import error_map, judge
from service.sinks.canvas import _ticks, draw
from service.sinks.drawing import panels_of, title_of, write_preview
from service.sinks.pictures import Pictures
from service.sinks.shading import Surface
from solver.completion.reason import DARK, MEASURED


@pytest.fixture(scope="module")
def step() -> FusedMap:
    """A step in distance, 2 m to 2.5 m, with a hole that nothing was seen in."""
    from scripted import frame

    nominal = sr3000_calibration()
    metres = np.where(np.arange(44) < 22, 2.0, 2.5) * np.ones((36, 1))
    counts = np.round(metres * 65536 / 7.5).astype(np.uint16)
    counts[:6, :6] = 0
    light = np.full((36, 44), 2000, np.uint16)
    centre = nominal.intrinsics.model_copy(update={"cx": 21.5, "cy": 17.5})
    calibration = nominal.model_copy(update={"width": 44, "height": 36, "intrinsics": centre})
    frames = tuple(frame(k, counts=counts, amplitude=light) for k in range(2))
    settings = FusionSection(method="nearest", upsampling=2, register_poses=False, fill=1)
    return fuse_burst(Burst(3, frames, calibration, 2), settings)


TRUTH = np.where(np.arange(88) < 44, 2.0, 2.5).astype(np.float32) * np.ones((72, 1), np.float32)


def test_the_picture_has_six_panels_with_units(step: FusedMap) -> None:
    titles = [panel.title for panel in panels_of(step, TRUTH)]
    assert len(titles) == 6
    assert sum(title.startswith("surface, seen") for title in titles) == 2
    assert all(title.startswith("surface") or ", m" in title or ", counts" in title for title in titles)
    assert titles[-1] == "error, fused − true distance, mm"
    assert "RMS error" in title_of(step, judge(step, TRUTH))


def test_it_shows_why_depths_are_unknown(step: FusedMap) -> None:
    assert set(np.unique(step.reason)) == {MEASURED, DARK}
    depth = panels_of(step, TRUTH)[2]
    assert depth.names == (f"dark {np.mean(step.reason == DARK):.1%}", "saturated", "contradicted", "outside")
    assert depth.marks is not None
    np.testing.assert_array_equal(depth.marks == 1, step.reason == DARK)
    sheets = [np.asarray(draw([panel], "").convert("RGB")) for panel in (depth, replace(depth, marks=None))]
    black = [(sheet == 0).all(axis=2).sum() for sheet in sheets]
    assert black[0] > black[1] + 100  # black is no colour of a depth


def test_without_a_truth_it_shows_the_deviation(step: FusedMap) -> None:
    for missing in (None, np.zeros((5, 5), np.float32)):
        assert panels_of(step, missing)[-1].title == "standard deviation, mm"
        assert "median deviation" in title_of(step, judge(step, missing))


def test_near_and_far_have_the_colours_of_their_distance(step: FusedMap, tmp_path: Path) -> None:
    write_preview(tmp_path / "a.png", step, TRUTH)
    picture = cv2.imread(str(tmp_path / "a.png")).astype(int)
    ends = cv2.applyColorMap(np.array([[0, 255]], np.uint8), cv2.COLORMAP_VIRIDIS)[0]
    for left in (16, 16 + 2 * 530):  # the frame's distance, the fused depth
        near, far = picture[76 + 300, left + 50], picture[76 + 300, left + 380]
        assert np.abs(near - ends[0]).max() < 24
        assert np.abs(far - ends[1]).max() < 24
    assert (picture[76 + 20, 16 + 20] == 0xC8).all(), "nothing was seen there"
    middle = picture[76 + 405 + 300, 16 + 2 * 530 + 50]
    assert (middle > 235).all(), "no error is white"


def test_a_scale_has_a_few_round_values() -> None:
    for low, high in ((0.0, 1.0), (1.83, 3.71), (-12.7, 12.7), (0.0, 2713.0), (2.0, 2.001)):
        ticks = _ticks(low, high)
        assert 3 <= len(ticks) <= 8
        assert all(low - 1e-9 <= value <= high + 1e-9 for value, _ in ticks)
        assert len({label for _, label in ticks}) == len(ticks)
    assert [label for _, label in _ticks(-12.7, 12.7)] == ["−10", "−5", "0", "5", "10"]


def test_it_is_written_whole_or_not_at_all(step: FusedMap, tmp_path: Path) -> None:
    write_preview(tmp_path / "a.png", step)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    assert cv2.imread(str(tmp_path / "a.png")).shape[:2] == (860, 1600)
    with pytest.raises(OutputError, match="nowhere"):
        write_preview(tmp_path / "nowhere" / "a.png", step)


def test_a_map_of_nothing_can_be_drawn_too(step: FusedMap, tmp_path: Path) -> None:
    nothing = np.full_like(step.distance, np.nan)
    for truth in (None, TRUTH):
        write_preview(
            tmp_path / "a.png", replace(step, distance=nothing, depth=nothing, deviation=nothing), truth
        )


def test_errors_are_those_of_the_pixels_that_all_know(step: FusedMap) -> None:
    error = error_map(step, TRUTH)
    assert error is not None
    assert np.nanmax(np.abs(error)) < 2e-4
    assert np.isnan(error[0, 0])
    quality = judge(step, TRUTH + np.float32(0.01))
    assert quality is not None
    assert quality.rms == pytest.approx(0.01, abs=1e-4)
    assert quality.mean_absolute == pytest.approx(quality.nearest_mean_absolute, abs=1e-4)
    assert quality.pixels == 88 * 72 - 12 * 12, "the hole is known to the filled map alone, or to nobody"
    assert judge(step, None) is None


def test_a_surface_faces_its_viewer_and_hides_what_is_behind_it() -> None:
    K = np.array([[200.0, 0, 31.5], [0, 200.0, 23.5], [0, 0, 1]])
    rows, columns = np.mgrid[:48, :64]
    ray = np.sqrt(1 + ((columns - 31.5) / 200) ** 2 + ((rows - 23.5) / 200) ** 2)
    wall = (2.0 * ray).astype(np.float32)
    picture = Surface(wall, K, None).seen_from(0.0, 0.0)
    seen = picture[np.isfinite(picture)]
    assert np.ptp(seen) < 0.01, "a flat wall is evenly lit"
    askew = Surface(wall, K, None).seen_from(0.5, 0.0)
    assert not np.isclose(np.nanmedian(askew), np.nanmedian(picture), atol=0.01)
    wall[20:28, 28:36] *= 0.5
    holed = Surface(wall, K, None).seen_from(0.6, 0.0)
    assert np.isnan(holed[147:206, 67:365]).any(), "seen askew, the block leaves a shadow on the wall"


@pytest.mark.parametrize(("lossless", "niceness"), [(False, 15), (True, 5)])
def test_who_draws_gives_way_to_all_but_a_run_that_waits(
    step: FusedMap, tmp_path: Path, lossless: bool, niceness: int
) -> None:
    pictures = Pictures(tmp_path, lossless=lossless)
    pictures.open()
    try:
        pictures.take(MapFused(step, None))
        own = os.getpriority(os.PRIO_PROCESS, 0)
        assert os.getpriority(os.PRIO_PROCESS, pictures._worker.pid) == min(19, own + niceness)
    finally:
        pictures.close()
    assert [path.name for path in tmp_path.iterdir()] == ["burst-0003.png"]
