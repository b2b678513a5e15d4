"""Mixed samples as means of distances."""

import numpy as np
import pytest

from solver import FusionOptions, SlidingFusion, fuse
from solver.preparation.unmixing import Unmixing

FRAMES, ROWS, COLUMNS = 15, 12, 20
NEAR, FAR = 2.0, 2.6
RANGE = 7.5
EDGE, TILT = 7.8, 0.31
"""Column of the edge in row 0, and columns to the right by row."""


def edge(ratio: float, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames of a near half, so many times as bright as the far one, the shares of it, and (dy, dx)."""
    random = np.random.default_rng(4)
    shifts = random.uniform(-1, 1, (FRAMES, 2))
    shifts[0] = 0
    at = np.arange(COLUMNS) + shifts[:, 1:]
    rows = np.arange(ROWS) + shifts[:, :1]
    share = np.clip(EDGE + TILT * rows[:, :, None] - at[:, None] + 0.5, 0, 1)
    turn = 2j * np.pi / RANGE
    phasor = share * ratio * np.exp(turn * NEAR) + (1 - share) * np.exp(turn * FAR)
    distance = np.angle(phasor) % (2 * np.pi) * RANGE / (2 * np.pi)
    distance += noise * random.normal(size=distance.shape)
    return distance.astype(np.float32), share, shifts


def learned(distance: np.ndarray, shifts: np.ndarray, sigma: float, lost: float = 0.6) -> Unmixing:
    shape = distance.shape
    bounds = (np.full(shape[1:], NEAR, np.float32), np.full(shape[1:], FAR, np.float32))
    return Unmixing(distance, np.full(shape, sigma, np.float32), places(shifts), bounds, lost)


def places(shifts: np.ndarray) -> np.ndarray:
    grid = np.stack(np.mgrid[0:ROWS, 0:COLUMNS], axis=-1)
    return (grid + shifts[:, None, None]).astype(np.float32)


@pytest.mark.parametrize("ratio", [0.25, 0.5, 1.0, 2.0, 4.0])
def test_the_ratio_of_lights_is_read_off_the_distances(ratio: float) -> None:
    distance, share, shifts = edge(ratio)
    unmixing = learned(distance, shifts, 0.001)
    at_edge = [unmixing.ratio[row, round(EDGE + TILT * row)] for row in range(2, ROWS - 2)]
    assert np.median(at_edge) == pytest.approx(np.log(ratio), abs=0.7)
    sigma = np.full_like(distance, 0.001)
    means, deviation = unmixing.means(distance, sigma, places(shifts), np.float32(0))
    true = share * NEAR + (1 - share) * FAR
    mixed = (share > 0.05) & (share < 0.95)
    before, after = (np.abs(found - true)[mixed].mean() for found in (distance, means))
    assert after < (0.65 * before if ratio != 1 else 0.05)
    assert (deviation >= 0.001).all()
    assert (deviation[share == 0] < 0.002).all()


def test_where_noise_hides_the_shares_samples_stay() -> None:
    distance, _, shifts = edge(8.0)
    sigma = np.full_like(distance, 0.2)
    means, deviation = learned(distance, shifts, 0.2).means(distance, sigma, places(shifts), np.float32(0))
    np.testing.assert_allclose(means, distance, atol=1e-5)
    assert (deviation >= 0.2).all()


def test_where_samples_are_lost_there_is_no_far_surface() -> None:
    distance, share, shifts = edge(8.0)
    distance[share < 0.5] = np.nan
    ratio = learned(distance, shifts, 0.001).ratio
    assert all(ratio[row, round(EDGE + TILT * row)] == 0 for row in range(ROWS))


@pytest.mark.parametrize("amplitude", [True, False])
def test_a_bright_thing_is_not_too_wide(amplitude: bool) -> None:
    distance, _, shifts = edge(8.0, noise=0.003)
    light = np.full_like(distance, 1000) if amplitude else None
    given = {"noise": 3.0 if amplitude else 0.003, "options": FusionOptions(method="area")}
    maps = [fuse(distance, light, shifts=shifts, ambiguity_range=known, **given) for known in (RANGE, None)]
    assert abs(excess(maps[0].distance)) < 0.12
    assert abs(excess(maps[1].distance)) > 0.25


def test_nor_is_it_in_a_stream() -> None:
    distance, _, shifts = edge(8.0, noise=0.003)
    sliding = SlidingFusion(FusionOptions(method="area"), window=9, ambiguity_range=RANGE, noise=0.003)
    for frame, shift in zip(distance, shifts, strict=True):
        found = sliding.push(frame, shift=shift)
    assert abs(excess(found.distance)) < 0.15


def excess(distance: np.ndarray) -> float:
    """By how many low-resolution pixels the near half is too wide."""
    width = np.mean(distance[16:-16] < (NEAR + FAR) / 2) * COLUMNS
    return float(width - (EDGE + TILT * (ROWS - 1) / 2 + 0.5))


@pytest.mark.parametrize("ends", [(-np.inf, np.inf), (NEAR, NEAR), (0.0005, 7.0)])
def test_what_cannot_be_told_stays_finite(ends: tuple[float, float]) -> None:
    distance, _, shifts = edge(2.0)
    sigma = np.full_like(distance, 0.001)
    sigma[0] = np.inf
    near, far = (np.full(distance.shape[1:], end, np.float32) for end in ends)
    unmixing = Unmixing(distance, sigma, places(shifts), (near, far), 0.6)
    means, deviation = unmixing.means(distance, sigma, places(shifts), np.float32(0))
    assert np.isfinite(unmixing.ratio).all()
    assert np.isfinite(means).all()
    assert not np.isnan(deviation).any()
    assert np.isfinite(deviation[1:]).all()


@pytest.mark.filterwarnings("ignore:area stopped after")
def test_a_lit_wall_is_known_where_most_of_the_view_is_dark() -> None:
    random = np.random.default_rng(0)
    shape = (6, 24, 30)
    amplitude, distance = np.ones(shape, np.float32), random.uniform(0.5, 7, shape).astype(np.float32)
    amplitude[:, :, :10] = 1000
    distance[:, :, :10] = 2 + random.normal(0, 0.005, (6, 24, 10))
    shifts = random.uniform(-0.5, 0.5, (6, 2))
    shifts[0] = 0
    fused = fuse(
        distance,
        amplitude=amplitude,
        shifts=shifts,
        noise=5.0,
        ambiguity_range=7.5,
        options=FusionOptions(method="area", upsampling=2),
    )
    wall = fused.distance[8:40, 4:14]
    assert np.isfinite(wall).all()
    assert np.abs(wall - 2).max() < 0.05
