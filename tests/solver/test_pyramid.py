"""The sparse term starts from coarser grids: what is far from samples, or noisy, takes few iterations."""

import numpy as np
import pytest

from solver import FusionOptions, fuse
from solver.kernels.group import PAD
from solver.optimisation.prior import Prior
from solver.optimisation.pyramid import coarse_start

Frames = tuple[np.ndarray, np.ndarray]


def still(noise: float, hole: int = 0, count: int = 4) -> np.ndarray:
    """Frames (count, 48, 64) of a step and a slope, taken without moving; metres."""
    generator = np.random.default_rng(3)
    rows, columns = np.mgrid[:48, :64].astype(np.float32)
    scene = 2 + 0.4 * (columns > 30) + 0.004 * rows
    frames = scene + generator.normal(0, noise, (count, 48, 64))
    frames[:, 20 : 20 + hole, 10 : 10 + hole] = np.nan
    return frames.astype(np.float32)


@pytest.mark.parametrize(("noise", "hole"), [(0.01, 0), (0.2, 0), (0.05, 18)])
def test_still_noisy_frames_with_holes_take_no_more_than_300_iterations(noise: float, hole: int) -> None:
    frames, shifts = still(noise, hole), np.zeros((4, 2))
    found = fuse(frames, options=FusionOptions(method="lidarboost"), shifts=shifts).report
    settled = FusionOptions(method="lidarboost", tolerance=1e-5, max_iterations=4000)
    least = fuse(frames, options=settled, shifts=shifts).report.objective
    assert found.converged
    assert found.iterations <= 300
    assert found.objective <= 1.002 * least


@pytest.mark.parametrize("shape", [(64, 96), (61, 83), (5, 7), (1, 1), (3, 200)])
@pytest.mark.parametrize("factor", [1, 2, 3, 8])
def test_one_value_everywhere_is_found_on_any_grid(shape: tuple[int, int], factor: int) -> None:
    weight = np.zeros(shape, np.float32)
    weight[::2, ::3] = 5
    state = coarse_start(7 * (weight > 0).astype(np.float32), weight, factor, Prior(), 1e-3)
    start = state.x[0, PAD:-PAD, PAD:-PAD]
    assert start.shape == shape
    np.testing.assert_allclose(start, 7, rtol=1e-3)


def test_a_step_stays_where_it_is() -> None:
    weight = np.zeros((64, 128), np.float32)
    weight[::2, ::2] = 50
    scene = np.where(np.arange(128) < 63, np.float32(-10), np.float32(10))[None].repeat(64, 0)
    state = coarse_start(np.where(weight > 0, scene, 0).astype(np.float32), weight, 2, Prior(), 1e-3)
    start = state.x[0, PAD:-PAD, PAD:-PAD]
    assert np.abs(start[:, :58] + 10).max() < 0.5
    assert np.abs(start[:, 68:] - 10).max() < 0.5
    crossing = np.abs(start).argmin(axis=1)
    assert np.abs(crossing - 63).max() <= 1
