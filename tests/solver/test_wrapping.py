"""Distances around the end of the ambiguity range."""

import numpy as np
import pytest

from solver import FusionOptions, SlidingFusion, fuse
from solver.options import Method
from solver.preparation.wrapping import find_cut, unwrapped, wrapped

RANGE = 7.5


def spread(low: float, high: float) -> np.ndarray:
    """(2, 24, 30) distances evenly from low to high, modulo the range."""
    return np.mod(np.linspace(low, high, 2 * 24 * 30), RANGE).reshape(2, 24, 30).astype(np.float32)


def certain(distance: np.ndarray) -> np.ndarray:
    return np.full_like(distance, 0.01)


@pytest.mark.parametrize(("low", "high"), [(0.9, 4.0), (0.05, 3.0), (5.0, 7.0)])
def test_there_is_no_cut_where_nothing_is_near_the_end(low: float, high: float) -> None:
    distance = spread(low, high)
    assert find_cut(distance, certain(distance), RANGE) == 0.0
    assert unwrapped(distance, 0.0, RANGE) is distance


@pytest.mark.parametrize(("low", "high"), [(6.0, 9.0), (7.3, 7.7), (2.0, 8.5)])
def test_what_lies_beyond_the_end_comes_to_lie_behind_it(low: float, high: float) -> None:
    distance = spread(low, high)
    cut = find_cut(distance, certain(distance), RANGE)
    assert high - RANGE < cut < low
    straight = unwrapped(distance, cut, RANGE)
    np.testing.assert_allclose(straight.ravel(), np.linspace(low, high, straight.size), atol=1e-5)
    np.testing.assert_allclose(wrapped(straight, cut, RANGE), distance, atol=1e-5)


def test_samples_that_may_lie_anywhere_do_not_count() -> None:
    distance = spread(1.0, 3.0)
    sigma = certain(distance)
    distance[:, :4] = np.random.default_rng(2).uniform(0, RANGE, distance[:, :4].shape)
    sigma[:, :4] = 1.0
    assert find_cut(distance, sigma, RANGE) == 0.0


def test_where_there_are_some_everywhere_the_cut_is_where_there_are_least() -> None:
    distance = spread(3.0, 9.0)
    distance[0, ::3, 0] = np.linspace(1.3, 2.9, 8)  # one of twenty that are counted
    assert 1.5 < find_cut(distance, certain(distance), RANGE) <= 3.0


@pytest.mark.parametrize("columns", [88, 89, 120, 176])
def test_a_range_that_is_full_of_samples_is_not_cut(columns: int) -> None:
    distance = np.random.default_rng(columns).uniform(0, RANGE, (4, 72, columns)).astype(np.float32)
    assert find_cut(distance, certain(distance), RANGE) == 0.0


@pytest.mark.parametrize("method", ["lidarboost", "area", "phasor"])
def test_a_wall_through_the_end_of_the_range_is_as_good_as_any(method: Method) -> None:
    random = np.random.default_rng(5)
    shifts = random.uniform(-1, 1, (10, 2))
    shifts[0] = 0
    rows = np.mgrid[:20, :24][0] + shifts[:, 0, None, None]

    def off(start: float) -> tuple[float, np.ndarray]:
        distance = start + 0.02 * rows + np.random.default_rng(7).normal(0, 0.02, rows.shape)
        frames, light = np.mod(distance, RANGE).astype(np.float32), np.ones(rows.shape, np.float32)
        options = FusionOptions(method=method, upsampling=2)
        fused = fuse(frames, light, shifts=shifts, ambiguity_range=RANGE, noise=0.02, options=options)
        truth = start + 0.02 * ((np.arange(40) + 0.5) / 2 - 0.5)
        error = np.mod(fused.distance - truth[:, None] + RANGE / 2, RANGE) - RANGE / 2
        return float(np.sqrt(np.mean(error**2))), fused.distance

    plain, through = off(3.0), off(RANGE - 0.2)
    assert plain[0] < 0.02
    assert through[0] < 1.2 * plain[0] + 1e-3
    assert (through[1] >= 0).all()
    assert (through[1] < RANGE).all()


def test_a_stream_cuts_new_frames_where_it_cut_the_first() -> None:
    random = np.random.default_rng(5)
    shifts = random.uniform(-1, 1, (12, 2))
    frames = np.mod(RANGE + random.normal(0, 0.05, (12, 16, 20)), RANGE).astype(np.float32)
    light = np.ones_like(frames)
    options = FusionOptions(method="area", upsampling=2)
    stream = SlidingFusion(options, window=8, ambiguity_range=RANGE, noise=0.05)
    for number in range(12):
        last = stream.push(frames[number], light[number], shift=shifts[number])
    error = np.mod(last.distance + RANGE / 2, RANGE) - RANGE / 2
    assert np.abs(error).max() < 0.15
