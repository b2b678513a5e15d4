"""What λ of `lidarboost` goes by, and how much a noisy sample counts."""

import numpy as np
import pytest
from made_bursts import burst, depth

from solver import FusionOptions, fuse

NOISE = 0.01


def strength(distance: np.ndarray, shifts: np.ndarray, upsampling: int = 4) -> float:
    options = FusionOptions(method="lidarboost", upsampling=upsampling)
    found = fuse(distance, shifts=shifts, options=options, noise=NOISE).report.regularization
    assert found is not None
    return found


def test_lambda_goes_by_the_noise_in_the_sum_on_a_fused_pixel() -> None:
    random = np.random.default_rng(0)
    distance = (2 + NOISE * random.normal(size=(16, 24, 24))).astype(np.float32)
    shifts = random.uniform(-0.5, 0.5, (16, 2))
    shifts[0] = 0
    whole = strength(distance, shifts)
    assert strength(distance, shifts, upsampling=8) == pytest.approx(whole / 2, rel=0.05)
    assert strength(distance[:4], shifts[:4]) == pytest.approx(whole / 2, rel=0.05)
    sparse = np.where(random.random(distance.shape) < 0.75, np.float32(np.nan), distance)
    assert strength(sparse, shifts) == pytest.approx(whole / 2, rel=0.1)
    half = distance.copy()
    half[:, :, 12:] = np.nan  # what nothing is known of changes nothing of the rest
    assert strength(half, shifts) == pytest.approx(whole, rel=0.1)


@pytest.mark.parametrize("upsampling", [2, 4, 8])
def test_lambda_that_suits_what_is_lit_suits_what_is_dim(upsampling: int) -> None:
    scene = burst(0.0, rows=36, columns=40, frames=15)
    amplitude = np.full(scene.distance.shape, 1000, np.float32)
    amplitude[:, :, :20] = 250
    noise = np.random.default_rng(1).normal(size=scene.distance.shape) * NOISE * 1000 / amplitude
    distance = (scene.distance + noise).astype(np.float32)

    y, x = ((np.arange(upsampling * size) + 0.5) / upsampling - 0.5 for size in (36, 40))
    truth = depth(y[:, None], x[None])

    def error(regularization: float | str) -> tuple[float, float]:
        options = FusionOptions(
            method="lidarboost",
            upsampling=upsampling,
            regularization=regularization,  # type: ignore[arg-type]
        )
        found = fuse(distance, amplitude, shifts=scene.shifts, options=options, noise=NOISE * 1000)
        assert found.report.regularization is not None
        return float(np.abs(found.distance - truth).mean()), found.report.regularization

    automatic, used = error("auto")
    assert automatic < 1.15 * min(error(factor * used)[0] for factor in (0.25, 0.5, 2.0, 4.0))


def test_samples_that_all_lack_light_count_alike() -> None:
    distance = (2 + NOISE * np.random.default_rng(0).normal(size=(5, 16, 16))).astype(np.float32)
    options = FusionOptions(method="lidarboost", amplitude_threshold=0.0)
    found = fuse(distance, np.zeros_like(distance), shifts=np.zeros((5, 2)), options=options, noise=NOISE)
    assert np.abs(found.distance - 2).max() < 5 * NOISE
