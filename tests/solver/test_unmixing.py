"""Mixed samples as means of distances."""

import numpy as np
import pytest

from solver import FusionOptions, SlidingFusion, fuse
from solver.preparation import counts, lights
from solver.preparation.consensus import Consensus
from solver.preparation.unmixing import Unmixing

FRAMES, ROWS, COLUMNS = 15, 12, 20
NEAR, FAR = 2.0, 2.6
RANGE, LOST = 7.5, 0.6
EDGE, TILT = 7.8, 0.31
"""Column of the edge in row 0, and columns to the right by row."""
WIDTH = 1.25
"""Of laths: five fused pixels."""


def edge(ratio: float, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frames of a near half, so many times as bright as the far one: lights, its shares, and (dy, dx)."""
    random = np.random.default_rng(4)
    shifts = random.uniform(-1, 1, (FRAMES, 2))
    shifts[0] = 0
    at = np.arange(COLUMNS) + shifts[:, 1:]
    rows = np.arange(ROWS) + shifts[:, :1]
    share = np.clip(EDGE + TILT * rows[:, :, None] - at[:, None] + 0.5, 0, 1)
    distance, light = mixed(share, ratio)
    distance += noise * random.normal(size=distance.shape).astype(np.float32)
    return distance, light, share, shifts


def mixed(share: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances and lights of pixels with a share of the near surface; the far one's light is 1000."""
    turn = 2j * np.pi / RANGE
    phasor = 1000 * (share * ratio * np.exp(turn * NEAR) + (1 - share) * np.exp(turn * FAR))
    distance = np.angle(phasor) % (2 * np.pi) * RANGE / (2 * np.pi)
    return distance.astype(np.float32), np.abs(phasor).astype(np.float32)


def learned(distance: np.ndarray, shifts: np.ndarray, sigma: float, light: np.ndarray | None) -> Unmixing:
    """Between the true distances."""
    shape = distance.shape
    bounds = (np.full(shape[1:], NEAR, np.float32), np.full(shape[1:], FAR, np.float32))
    samples = distance, np.full(shape, sigma, np.float32), np.float32(LOST), places(shifts)
    if light is None:
        return Unmixing(bounds, counts.ratio(samples, bounds), 0.3)
    return Unmixing(bounds, lights.ratio(samples, light, bounds), 0.1)


def places(shifts: np.ndarray) -> np.ndarray:
    grid = np.stack(np.mgrid[0:ROWS, 0:COLUMNS], axis=-1)
    return (grid + shifts[:, None, None]).astype(np.float32)


@pytest.mark.parametrize("lit", [True, False])
@pytest.mark.parametrize("ratio", [0.25, 0.5, 1.0, 2.0, 4.0])
def test_the_ratio_of_lights_is_read_off_the_samples(ratio: float, lit: bool) -> None:
    distance, light, share, shifts = edge(ratio)
    unmixing = learned(distance, shifts, 0.001, light if lit else None)
    at_edge = [unmixing.ratio[row, round(EDGE + TILT * row)] for row in range(2, ROWS - 2)]
    assert np.median(at_edge) == pytest.approx(np.log(ratio), abs=0.2 if lit else 0.7)
    sigma = np.full_like(distance, 0.001)
    means, deviation = unmixing.means(distance, sigma, places(shifts), np.float32(0))
    true = share * NEAR + (1 - share) * FAR
    between = (share > 0.05) & (share < 0.95)
    before, after = (np.abs(found - true)[between].mean() for found in (distance, means))
    assert after < ((0.35 if lit else 0.65) * before if ratio != 1 else 0.05)
    assert (deviation >= 0.001).all()
    assert (deviation[share == 0] < 0.002).all()


@pytest.mark.parametrize("lit", [True, False])
def test_where_noise_hides_the_shares_samples_stay(lit: bool) -> None:
    distance, light, _, shifts = edge(8.0)
    sigma = np.full_like(distance, 0.2)
    unmixing = learned(distance, shifts, 0.2, light if lit else None)
    means, deviation = unmixing.means(distance, sigma, places(shifts), np.float32(0))
    np.testing.assert_allclose(means, distance, atol=1e-5)
    assert (deviation >= 0.2).all()


@pytest.mark.parametrize("lit", [True, False])
def test_where_samples_are_lost_there_is_no_far_surface(lit: bool) -> None:
    distance, light, share, shifts = edge(8.0)
    distance[share < 0.5] = np.nan
    ratio = learned(distance, shifts, 0.001, light if lit else None).ratio
    assert all(ratio[row, round(EDGE + TILT * row)] == 0 for row in range(ROWS))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_near_and_far_are_those_of_one_surface_where_medians_are_mixed(noise: float) -> None:
    random = np.random.default_rng(1)
    shifts = np.stack([np.zeros(FRAMES), np.linspace(-1.5, 1.5, FRAMES)], axis=-1)
    distance, _ = mixed(laths(np.arange(COLUMNS) + shifts[:, 1:], 2.75), 1.0)
    distance = np.repeat(distance[:, None], ROWS, axis=1)
    distance += noise * random.normal(size=distance.shape).astype(np.float32)
    sigma = np.full_like(distance, noise)
    consensus = Consensus(distance, sigma, places(shifts), RANGE, wraps=False)
    near, far = lights.ends(distance, sigma, LOST, places(shifts), consensus.bounds)
    inner = (slice(2, -2), slice(3, -3))
    assert np.abs(near[inner] - NEAR).max() < 0.07
    assert np.abs(far[inner] - FAR).max() < 0.07
    assert (consensus.bounds[0][inner] - NEAR).max() > 0.14  # the median's


def laths(at: np.ndarray, pitch: float) -> np.ndarray:
    """The part of pixels at these columns that upright laths have."""
    edges = np.stack([at - 0.5, at + 0.5])
    covered = np.floor(edges / pitch) * WIDTH + np.minimum(edges % pitch, WIDTH)
    return np.asarray(covered[1] - covered[0])


@pytest.mark.parametrize("wild", [False, True])
def test_better_data_make_laths_no_worse(wild: bool) -> None:
    usual = fused_laths(FRAMES, 0.01, wild)
    assert usual < 0.0063
    assert fused_laths(FRAMES, 0.0025, wild) < 0.5 * usual
    assert fused_laths(4 * FRAMES, 0.01, wild) < 0.95 * usual


def fused_laths(frames: int, noise: float, wild: bool) -> float:
    """The RMS error of `area` on laths twice as bright as what is behind them."""
    random = np.random.default_rng(2)
    shifts = random.uniform(-1.5, 1.5, (frames, 2))
    shifts[0] = 0
    distance, light = mixed(laths(np.arange(COLUMNS) + shifts[:, 1:], 3.5), 2.0)
    distance, light = (np.repeat(image[:, None], ROWS, axis=1) for image in (distance, light))
    distance += (noise * 1500 / light) * random.normal(size=distance.shape).astype(np.float32)
    if wild:
        hit = random.random(distance.shape) < 0.002
        distance[hit] = random.uniform(0.5, 7, int(hit.sum()))
    options = FusionOptions(method="area")
    found = fuse(distance, light, shifts=shifts, ambiguity_range=RANGE, noise=1500 * noise, options=options)
    at = (np.arange(4 * COLUMNS) - 1.5) / 4
    true = np.where(at % 3.5 < WIDTH, NEAR, FAR)
    return float(np.sqrt(np.mean((found.distance - true)[8:-8, 12:-12] ** 2)))


@pytest.mark.parametrize("lit", [True, False])
def test_a_bright_thing_is_not_too_wide(lit: bool) -> None:
    distance, light, _, shifts = edge(8.0, noise=0.003)
    given = {"noise": 0.003 * 4000 if lit else 0.003, "options": FusionOptions(method="area")}
    amplitude = light if lit else None
    maps = [
        fuse(distance, amplitude, shifts=shifts, ambiguity_range=known, **given) for known in (RANGE, None)
    ]
    assert abs(excess(maps[0].distance)) < 0.12
    assert abs(excess(maps[1].distance)) > 0.25


@pytest.mark.parametrize("lit", [True, False])
def test_nor_is_it_in_a_stream(lit: bool) -> None:
    distance, light, _, shifts = edge(8.0, noise=0.003)
    noise = 0.003 * 4000 if lit else 0.003
    sliding = SlidingFusion(FusionOptions(method="area"), window=9, ambiguity_range=RANGE, noise=noise)
    for frame, lights_of_it, shift in zip(distance, light, shifts, strict=True):
        found = sliding.push(frame, lights_of_it if lit else None, shift=shift)
    assert abs(excess(found.distance)) < 0.15


def excess(distance: np.ndarray) -> float:
    """By how many low-resolution pixels the near half is too wide."""
    width = np.mean(distance[16:-16] < (NEAR + FAR) / 2) * COLUMNS
    return float(width - (EDGE + TILT * (ROWS - 1) / 2 + 0.5))


@pytest.mark.parametrize("lit", [True, False])
@pytest.mark.parametrize("ends", [(-np.inf, np.inf), (NEAR, NEAR), (0.0005, 7.0)])
def test_what_cannot_be_told_stays_finite(ends: tuple[float, float], lit: bool) -> None:
    distance, light, _, shifts = edge(2.0)
    sigma = np.full_like(distance, 0.001)
    sigma[0], light[0] = np.inf, 0
    near, far = (np.full(distance.shape[1:], end, np.float32) for end in ends)
    samples = distance, sigma, np.float32(LOST), places(shifts)
    ratio = lights.ratio(samples, light, (near, far)) if lit else counts.ratio(samples, (near, far))
    assert np.isfinite(ratio).all()
    unmixing = Unmixing((near, far), ratio, 0.3)
    means, deviation = unmixing.means(distance, sigma, places(shifts), np.float32(0))
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
