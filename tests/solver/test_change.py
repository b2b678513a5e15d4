"""Streams whose scene, light or view changes: their maps become those of `fuse` of the same frames."""

from dataclasses import dataclass

import made_streams as streams
import numpy as np
import pytest

from solver import Fused, FusionOptions, SlidingFusion, fuse
from solver.options import Method

ROWS, COLUMNS, FRAMES, BEGIN, WINDOW, RANGE = 24, 30, 40, 16, 9, 7.5
METHODS: tuple[Method, ...] = ("lidarboost", "area", "phasor")


@dataclass
class Footage:
    """A tilted wall with a block before it; frames of (N, H, W), which look at pixels (N, H, W, 2)."""

    distance: np.ndarray
    amplitude: np.ndarray
    shifts: np.ndarray
    at: np.ndarray

    def paint(self, number: int, box: tuple[int, int, int, int], distance: float) -> None:
        """Have a thing from row to row and column to column in a frame."""
        y, x = np.moveaxis(self.at[number], -1, 0)
        on = (y >= box[0]) & (y < box[1]) & (x >= box[2]) & (x < box[3])
        self.distance[number][on] = distance

    def streamed(self, method: Method, noise: float | None, numbers: range) -> list[tuple[Fused, Fused]]:
        """The stream's maps after frames of these numbers, and those of `fuse`."""
        options = FusionOptions(method=method, upsampling=2)
        sliding = SlidingFusion(options, window=WINDOW, ambiguity_range=RANGE, noise=noise)
        found = []
        for number in range(numbers.stop):
            stream = sliding.push(self.distance[number], self.amplitude[number], shift=self.shifts[number])
            if number in numbers:
                window = slice(number + 1 - WINDOW, number + 1)
                frames, known = (self.distance[window], self.amplitude[window]), {"ambiguity_range": RANGE}
                whole = fuse(*frames, shifts=self.shifts[window], noise=noise, options=options, **known)
                found.append((stream, whole))
        return found


@pytest.fixture
def footage() -> Footage:
    rng = np.random.default_rng(6)
    shifts = rng.uniform(-0.7, 0.7, (FRAMES, 2))
    shifts[0] = 0
    at = np.moveaxis(np.mgrid[0:ROWS, 0:COLUMNS], 0, -1) + shifts[:, None, None]
    y, x = np.moveaxis(at, -1, 0)
    block = np.clip(y - 5, 0, 1) * np.clip(14 - y, 0, 1) * np.clip(x - 4, 0, 1) * np.clip(12 - x, 0, 1)
    distance = 2.0 + 0.01 * x - 0.5 * block + 0.01 * rng.normal(size=block.shape)
    return Footage(distance.astype(np.float32), np.full(block.shape, 1000, np.float32), shifts, at)


def apart(pair: tuple[Fused, Fused], where: tuple[slice, slice]) -> float:
    """The mean difference of two maps in metres; half a metre where one alone is unknown."""
    one, other = (fused.distance[where] for fused in pair)
    difference = np.minimum(np.abs(one - other), 0.5)
    difference[np.isnan(one) & np.isnan(other)] = 0
    return float(np.nan_to_num(difference, nan=0.5).mean())


@pytest.mark.parametrize("method", METHODS)
def test_what_was_not_seen_at_first_is_shown_as_soon_as_it_is(method: Method, footage: Footage) -> None:
    footage.distance[:BEGIN, :, 15:] = np.nan
    pairs = footage.streamed(method, 10.0, range(BEGIN + WINDOW, BEGIN + WINDOW + 4))
    assert max(apart(pair, np.s_[4:-4, 34:-4]) for pair in pairs) < 0.004


@pytest.mark.parametrize("begin", [1, 5, 7, BEGIN, 27])
@pytest.mark.parametrize("method", METHODS)
def test_less_light_loses_no_map(method: Method, begin: int, footage: Footage) -> None:
    footage.amplitude[begin:] *= np.float32(0.1)
    more = 0.1 * np.random.default_rng(3).normal(size=footage.distance[begin:].shape)
    footage.distance[begin:] += more.astype(np.float32)
    pairs = footage.streamed(method, None, range(begin + WINDOW, min(begin + WINDOW + 4, FRAMES)))
    for pair in pairs[1:]:
        assert apart(pair, np.s_[4:-4, 4:-4]) < 0.02
        assert pair[0].report.noise == pytest.approx(pair[1].report.noise, rel=0.2)


@pytest.mark.parametrize("method", METHODS)
def test_more_noise_is_known_once_most_frames_have_it(method: Method, footage: Footage) -> None:
    more = 0.04 * np.random.default_rng(1).normal(size=footage.distance[BEGIN:].shape)
    footage.distance[BEGIN:] += more.astype(np.float32)
    for pair in footage.streamed(method, None, range(BEGIN + WINDOW, BEGIN + WINDOW + 4)):
        assert pair[0].report.noise == pytest.approx(pair[1].report.noise, rel=0.3)
        assert apart(pair, np.s_[4:-4, 4:-4]) < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_dark_frames_tell_nothing_of_the_noise(method: Method, footage: Footage) -> None:
    footage.amplitude[BEGIN : BEGIN + 6] = 0
    for stream, _ in footage.streamed(method, None, range(BEGIN + 6, BEGIN + WINDOW)):
        assert stream.report.noise == pytest.approx(10.0, rel=0.4)


@pytest.mark.parametrize("side", [3, 8])
@pytest.mark.parametrize("method", METHODS)
def test_a_thing_that_comes_and_stays_is_shown_or_doubted(
    method: Method, side: int, footage: Footage
) -> None:
    for number in range(BEGIN, FRAMES):
        footage.paint(number, (8, 8 + side, 18, 18 + side), 1.2)
    inside = np.s_[17 : 15 + 2 * side, 37 : 35 + 2 * side]
    for stream, _ in footage.streamed(method, 10.0, range(BEGIN + WINDOW, BEGIN + WINDOW + 6)):
        error = np.abs(stream.distance[inside] - 1.2)
        assert (error < 4 * stream.deviation[inside] + 0.02).mean() > 0.9


@pytest.mark.parametrize("method", METHODS)
def test_what_moves_spoils_nothing_elsewhere(method: Method, footage: Footage) -> None:
    for number in range(BEGIN, 34):
        footage.paint(number, (16, 21, number - BEGIN, number - BEGIN + 6), 1.2)
    for stream, whole in footage.streamed(method, 10.0, range(BEGIN + 2, 34)):
        assert apart((stream, whole), np.s_[4:26, 4:-4]) < 0.01


@pytest.mark.parametrize("method", ["lidarboost", "area", "phasor"])
def test_another_scene_is_as_fuse_gives_it_once_the_window_is_full_of_it(method: str) -> None:
    distance, amplitude, shifts = streams.long_stream(32)
    distance[14:] = distance[14:, ::-1, ::-1] + np.float32(0.4)
    amplitude[14:] *= np.linspace(0.2, 1.5, streams.COLUMNS, dtype=np.float32)
    turned = np.concatenate([shifts[:14], -shifts[14:]])
    options, known = FusionOptions(method=method), {"ambiguity_range": 7.5, "noise": 5.0}  # type: ignore[arg-type]
    sliding = SlidingFusion(options, window=9, **known)
    for number, shift in enumerate(turned):
        streamed = sliding.push(distance[number], amplitude[number], shift=shift)
        if number < 22:
            continue
        window = slice(number - 8, number + 1)
        whole = fuse(distance[window], amplitude[window], shifts=turned[window], options=options, **known)
        difference = np.abs(streamed.distance - whole.distance)[8:-8, 8:-8]
        # Noise of 5 mm to 30 mm; `area` learns from each window how lights mix.
        assert difference.mean() < (0.02 if method == "area" else 0.003)
