"""What λ of `lidarboost` and of `area` goes by, and how much a noisy sample counts."""

from typing import Any

import numpy as np
import pytest
from made_bursts import burst, depth

from solver import FusionOptions, fuse
from solver.evaluation import procedural_object
from solver.options import Method

NOISE = 0.01
RANGE = 7.5


def strength(
    distance: np.ndarray, shifts: np.ndarray, upsampling: int = 4, method: Method = "lidarboost", **given: Any
) -> float:
    options = FusionOptions(method=method, upsampling=upsampling)
    found = fuse(distance, shifts=shifts, options=options, **({"noise": NOISE} | given)).report.regularization
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


@pytest.mark.parametrize("span", [None, RANGE])
def test_lambda_of_area_goes_by_the_root_of_frames_and_upsampling(span: float | None) -> None:
    random = np.random.default_rng(0)
    distance = 2 + 0.2 * (np.arange(24) // 6) + NOISE * random.normal(size=(16, 24, 24))
    distance, shifts = distance.astype(np.float32), np.zeros((16, 2))
    whole = strength(distance, shifts, method="area", ambiguity_range=span)
    assert strength(distance, shifts, 8, "area", ambiguity_range=span) == pytest.approx(whole / np.sqrt(2))
    fewer = strength(distance[:4], shifts[:4], method="area", ambiguity_range=span)
    assert fewer == pytest.approx(whole / 2, rel=0.02)


def test_lambda_of_area_follows_the_unit_of_the_distances() -> None:
    distance = procedural_object()[None, ::2, ::2].repeat(3, axis=0)
    distance = (distance + np.random.default_rng(0).normal(size=distance.shape)).astype(np.float32)
    for span in (None, 400.0):
        metres, millimetres = (
            strength(
                unit * distance,
                np.zeros((3, 2)),
                method="area",
                noise=unit,
                ambiguity_range=span and unit * span,
            )
            for unit in (1.0, 1000.0)
        )
        assert millimetres == pytest.approx(1000 * metres, rel=1e-3)


def test_a_scene_without_extent_and_hardly_any_noise_has_a_lambda() -> None:
    flat = np.full((5, 16, 16), 2, np.float32)
    whole = strength(flat, np.zeros((5, 2)), method="area", noise=1e-9)
    assert 0 < strength(flat, np.zeros((5, 2)), 8, "area", noise=1e-9) == pytest.approx(whole / np.sqrt(2))


def test_what_gets_no_light_says_nothing_of_lambda() -> None:
    """An empty sky has the largest deviations and any distance."""
    random = np.random.default_rng(3)
    light = np.full((9, 24, 32), 1000.0)
    light[:, :, :20] = 0
    phasor = light * np.exp(2j * np.pi * (2 + 0.2 * (np.arange(32) // 24)) / RANGE)
    noise = 1000 * NOISE * 2 * np.pi / RANGE
    phasor += noise * (random.normal(size=light.shape) + 1j * random.normal(size=light.shape))
    distance = (np.angle(phasor) % (2 * np.pi) * RANGE / (2 * np.pi)).astype(np.float32)
    given = {"method": "area", "ambiguity_range": RANGE, "noise": 1000 * NOISE}
    amplitude, shifts = np.abs(phasor).astype(np.float32), np.zeros((9, 2))
    whole = strength(distance, shifts, amplitude=amplitude, **given)
    lit = strength(distance[:, :, 20:].copy(), shifts, amplitude=amplitude[:, :, 20:].copy(), **given)
    assert whole == pytest.approx(lit, rel=0.1)


@pytest.mark.parametrize("method", ["lidarboost", "area"])
@pytest.mark.parametrize("upsampling", [2, 4, 8])
def test_lambda_that_suits_what_is_lit_suits_what_is_dim(upsampling: int, method: Method) -> None:
    scene = burst(0.0, rows=36, columns=40, frames=15)
    amplitude = np.full(scene.distance.shape, 1000, np.float32)
    amplitude[:, :, :20] = 250
    noise = np.random.default_rng(1).normal(size=scene.distance.shape) * NOISE * 1000 / amplitude
    distance = (scene.distance + noise).astype(np.float32)

    y, x = ((np.arange(upsampling * size) + 0.5) / upsampling - 0.5 for size in (36, 40))
    truth = depth(y[:, None], x[None])

    def error(regularization: float | str) -> tuple[float, float]:
        options = FusionOptions(
            method=method,
            upsampling=upsampling,
            regularization=regularization,  # type: ignore[arg-type]
        )
        found = fuse(distance, amplitude, shifts=scene.shifts, options=options, noise=NOISE * 1000)
        assert found.report.regularization is not None
        return float(np.abs(found.distance - truth).mean()), found.report.regularization

    automatic, used = error("auto")
    assert automatic < 1.2 * min(error(factor * used)[0] for factor in (0.25, 0.5, 2.0, 4.0))


def test_samples_that_all_lack_light_count_alike() -> None:
    distance = (2 + NOISE * np.random.default_rng(0).normal(size=(5, 16, 16))).astype(np.float32)
    options = FusionOptions(method="lidarboost", amplitude_threshold=0.0)
    found = fuse(distance, np.zeros_like(distance), shifts=np.zeros((5, 2)), options=options, noise=NOISE)
    assert np.abs(found.distance - 2).max() < 5 * NOISE
