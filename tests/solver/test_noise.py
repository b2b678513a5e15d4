"""The noise law is read off the frames themselves."""

import numpy as np
import pytest

from solver.noise import estimate


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3])
def test_samples_without_light_tell_nothing_of_the_noise(share: float) -> None:
    rng = np.random.default_rng(1)
    amplitude = rng.uniform(50, 200, (5, 40, 50)).astype(np.float32)
    distance = (2 + rng.normal(size=amplitude.shape) / amplitude).astype(np.float32)
    amplitude[rng.random(amplitude.shape) < share] = 0
    assert estimate(distance, amplitude) == pytest.approx(1, rel=0.15)


def test_without_any_light_the_noise_is_not_known() -> None:
    distance = np.random.default_rng(1).normal(2, 0.01, (2, 9, 9)).astype(np.float32)
    assert estimate(distance, np.zeros_like(distance)) == 0
