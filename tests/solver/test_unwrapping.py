"""What noise carries past an end of the ambiguity range comes back."""

import numpy as np
import pytest

from solver import FusionOptions, SlidingFusion, fuse
from solver.unwrapping import circular_mean, unwrap

RANGE = 7.5


def frames(distance: float, sigma: float, count: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Noisy distances (N, 12, 14), their deviations, and where they look."""
    noise = np.random.default_rng(3).normal(0, sigma, (count, 12, 14))
    grid = np.moveaxis(np.indices((12, 14), np.float32), 0, -1)
    wrapped = np.mod(distance + noise, RANGE).astype(np.float32)
    return wrapped, np.full(wrapped.shape, sigma, np.float32), np.broadcast_to(grid, (*wrapped.shape, 2))


@pytest.mark.parametrize("distance", [7.45, 0.05])
def test_samples_come_back_to_the_turn_of_the_others(distance: float) -> None:
    found, sigma, places = frames(distance, 0.1)
    assert (np.abs(found - distance) > 3).mean() > 0.1
    mean = circular_mean(found, None, places, RANGE)
    unwrap(found, sigma, places, mean, RANGE)
    assert np.abs(np.mod(found - distance + 1, RANGE) - 1).max() < 0.5
    assert np.ptp(found[:, 5, 5]) < 0.7


def test_what_noise_does_not_explain_stays() -> None:
    found, sigma, places = frames(1.0, 0.02)
    found[3] = 7.45
    before = found.copy()
    unwrap(found, sigma, places, circular_mean(found, None, places, RANGE), RANGE)
    np.testing.assert_array_equal(found, before)


def test_area_gives_distances_within_the_range() -> None:
    found, _, _ = frames(7.47, 0.03, 12)
    shifts = np.random.default_rng(5).uniform(-1, 1, (12, 2))
    shifts[0] = 0
    options, light = FusionOptions(method="area", upsampling=2), np.ones_like(found)
    whole = fuse(found, light, shifts=shifts, ambiguity_range=RANGE, noise=0.03, options=options)
    stream = SlidingFusion(options, window=8, ambiguity_range=RANGE, noise=0.03)
    for number in range(12):
        last = stream.push(found[number], light[number], shift=shifts[number])
    for fused in (whole, last):
        assert (fused.distance >= 0).all()
        assert (fused.distance < RANGE).all()
