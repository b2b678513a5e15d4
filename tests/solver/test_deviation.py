"""The deviation map says how far the truth is."""

import cv2
import numpy as np
import pytest

from solver import FusionOptions, fuse
from solver.options import Method


@pytest.mark.parametrize("method", ["lidarboost", "area"])
def test_truth_lies_within_one_deviation_as_often_as_it_should(method: str, noisy_burst) -> None:  # type: ignore[no-untyped-def]
    _, burst = noisy_burst
    amplitude = np.full_like(burst.distance, 1000.0)
    fused = fuse(
        burst.distance,
        amplitude,
        shifts=burst.shifts,
        options=FusionOptions(method=method),  # type: ignore[arg-type]
    )
    error = np.abs(fused.distance - burst.truth)
    within = error[away_from_edges(burst.truth)] <= fused.deviation[away_from_edges(burst.truth)]
    assert 0.57 <= within.mean() <= 0.76


def test_deviation_grows_away_from_the_samples() -> None:
    frames = np.full((4, 24, 24), 2.0, np.float32) + np.random.default_rng(0).normal(
        scale=0.01, size=(4, 24, 24)
    ).astype(np.float32)
    frames[:, 8:16, 8:16] = np.nan
    fused = fuse(frames, shifts=np.zeros((4, 2)), options=FusionOptions(method="lidarboost"))
    middle, rim, seen = fused.deviation[48, 48], fused.deviation[36, 48], fused.deviation[16, 48]
    assert middle > 2 * rim > 2 * seen > 0
    assert fused.distance[48, 48] == pytest.approx(2.0, abs=0.02)


def away_from_edges(truth: np.ndarray) -> np.ndarray:
    """Fused pixels over one and a half low-resolution pixels away from steps of 0.1 m and the border."""
    step = cv2.morphologyEx(truth.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3)))
    far = cv2.dilate((step > 0.1).astype(np.uint8), np.ones((13, 13))) == 0
    far[:8] = far[-8:] = False
    far[:, :8] = far[:, -8:] = False
    return far


@pytest.mark.parametrize("method", ["area", "phasor"])
def test_what_lies_far_from_all_samples_has_no_absurd_deviation(method: Method) -> None:
    random = np.random.default_rng(0)
    shifts = random.uniform(-1, 1, (15, 2))
    shifts[0] = 0
    distance = (2 + 0.01 * random.normal(size=(15, 32, 32))).astype(np.float32)
    distance[:, :, 20:] = np.nan
    options = FusionOptions(method=method)
    light = np.full(distance.shape, 1000, np.float32)
    fused = fuse(distance, light, shifts=shifts, options=options, ambiguity_range=7.5, noise=10.0)
    stated = fused.deviation[np.isfinite(fused.distance)]
    assert 0 < stated.min() <= stated.max() < 1000


@pytest.mark.parametrize("upsampling", [4, 8])
def test_every_known_distance_has_a_deviation_though_samples_contradict_each_other(
    upsampling: int,
) -> None:
    rng = np.random.default_rng(0)
    shape, shifts = (5, 9, 11), rng.uniform(-0.6, 0.6, (5, 2))
    shifts[0] = 0
    distance = (2 + 0.3 * rng.random(shape)).astype(np.float32)
    amplitude = rng.uniform(100, 3000, shape).astype(np.float32)
    options = FusionOptions(method="phasor", upsampling=upsampling)
    fused = fuse(distance, amplitude, shifts=shifts, ambiguity_range=7.5, noise=1e-3, options=options)
    known = np.isfinite(fused.distance)
    assert known.any()
    assert np.isfinite(fused.deviation[known]).all()
