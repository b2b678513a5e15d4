"""The noise law is read off the frames themselves."""

import numpy as np
import pytest

from solver.evaluation import DepthMap, make_trial, procedural_object
from solver.preparation.noise import estimate


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


@pytest.mark.parametrize("lost", ["dark", "invalid"])
def test_frames_that_tell_nothing_do_not_stand_for_the_others(lost: str) -> None:
    rng = np.random.default_rng(1)
    amplitude = rng.uniform(50, 200, (15, 40, 50)).astype(np.float32)
    distance = (2 + rng.normal(size=amplitude.shape) / amplitude).astype(np.float32)
    (amplitude if lost == "dark" else distance)[[0, 3, 7, 10, 14]] = 0 if lost == "dark" else np.nan
    assert estimate(distance, amplitude) == pytest.approx(1, rel=0.15)


def seen(light: np.ndarray, distance: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Five frames of `light` (H, W), in deviations of a phasor's part: distances over the range, light."""
    rng = np.random.default_rng(5)
    parts = rng.normal(size=(2, 5, *light.shape))
    phasors = light * np.exp(2j * np.pi * distance) + parts[0] + 1j * parts[1]
    return (np.angle(phasors) / (2 * np.pi) % 1).astype(np.float32), np.abs(phasors).astype(np.float32)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.8])
def test_where_nothing_returns_there_is_no_less_noise(share: float) -> None:
    light = np.full((60, 80), 200.0)
    light[:, : int(share * 80)] = 0
    distance, amplitude = seen(light)
    assert estimate(distance, amplitude, 1.0) == pytest.approx(1 / (2 * np.pi), rel=0.06)


def test_what_is_dark_shows_no_less_noise_than_what_is_bright() -> None:
    light = np.full((60, 80), 2.0)
    light[:, :30] = 30.0
    distance, amplitude = seen(light)
    assert estimate(distance, amplitude, 1.0) == pytest.approx(1 / (2 * np.pi), rel=0.06)


@pytest.mark.parametrize("rough", ["leaves", "checks"])
def test_a_bright_rough_thing_does_not_outvote_the_wall_behind_it(rough: str) -> None:
    rows, columns = np.mgrid[:60, :80]
    thing, rng = (rows < 24) & (columns < 24), np.random.default_rng(2)
    relief = rng.uniform(0.1, 0.4, thing.shape) if rough == "leaves" else 0.2 * ((rows + columns) % 2)
    light, distance = np.where(thing, 600.0, 60.0), np.where(thing, relief, 0.4)
    noises = rng.normal(size=(2, 5, *light.shape))
    phasors = light * np.exp(2j * np.pi * distance) + noises[0] + 1j * noises[1]
    measured = (np.angle(phasors) / (2 * np.pi) % 1).astype(np.float32)
    found = estimate(measured, np.abs(phasors).astype(np.float32), 1.0)
    assert found == pytest.approx(1 / (2 * np.pi), rel=0.1)


@pytest.mark.parametrize("variance", [4.1, 46.3])
def test_fine_relief_is_hardly_taken_for_noise(variance: float) -> None:
    depth = DepthMap(procedural_object(), oversampling=2)
    for seed in range(3):
        trial = make_trial(depth, variance=variance, seed=seed)
        assert 0.9 < estimate(trial.distance, None) / np.sqrt(variance) < 1.2


def test_fine_relief_without_noise_is_none() -> None:
    trial = make_trial(DepthMap(procedural_object(), oversampling=2), variance=0, seed=0)
    assert estimate(trial.distance, None) < 1e-3
