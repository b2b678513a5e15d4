"""Problems that creep from pixel to pixel are solved on all grids at once."""

from itertools import pairwise

import numba
import numpy as np
import pytest

from solver import FusionOptions, fuse
from solver.optimisation import memory_gradient
from solver.optimisation.levels import Levels
from solver.options import Method

SHAPE = (40, 56)


def still_and_dark() -> np.ndarray:
    """Four frames of a slope and a step from one place; half the samples are lost, and noise is little."""
    generator = np.random.default_rng(5)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    frames = 2 + 0.4 * (columns > 30) + 0.01 * rows + generator.normal(0, 0.003, (4, *SHAPE))
    frames[:, generator.random(SHAPE) < 0.7] = np.nan
    return frames.astype(np.float32)


@pytest.mark.parametrize("method", ["lidarboost", "area", "mrf"])
def test_frames_that_take_long_from_pixel_to_pixel_take_at_most_300_iterations(method: Method) -> None:
    frames, shifts = still_and_dark(), np.zeros((4, 2))
    found = fuse(frames, options=FusionOptions(method=method), shifts=shifts).report
    assert found.converged
    assert found.iterations <= 300


def test_the_least_objective_is_found_in_fewer_iterations_than_from_pixel_to_pixel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames, shifts = still_and_dark(), np.zeros((4, 2))
    options = FusionOptions(method="area", tolerance=2e-4, max_iterations=2000)
    found = fuse(frames, options=options, shifts=shifts).report
    monkeypatch.setattr(memory_gradient, "_CREEPING", 10**9)
    crept = fuse(frames, options=options, shifts=shifts).report
    assert found.iterations < 0.8 * crept.iterations
    assert found.objective < 1.005 * crept.objective


def test_any_number_of_threads_gives_the_same_bits() -> None:
    frames, shifts = still_and_dark(), np.zeros((4, 2))
    before, maps = numba.get_num_threads(), []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            maps.append(fuse(frames, options=FusionOptions(method="area"), shifts=shifts).distance)
    finally:
        numba.set_num_threads(before)
    for one, other in pairwise(maps):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("shape", [(64, 96), (61, 83), (5, 7), (1, 1), (3, 200)])
def test_the_preconditioner_points_downhill(shape: tuple[int, int]) -> None:
    generator = np.random.default_rng(1)
    levels = Levels(generator.uniform(0, 1, shape).astype(np.float32))
    levels.stiffen(generator.uniform(0, 100, shape).astype(np.float32))
    for _ in range(5):
        gradient = generator.normal(size=shape).astype(np.float32)
        direction = levels.precondition(gradient, np.full(shape, 300, np.float32))
        assert direction.shape == shape
        assert (gradient * direction).sum() > 0


def test_a_wide_pull_moves_a_stiff_image_far_further_than_one_grid_would() -> None:
    shape = (64, 64)
    levels = Levels(np.full(shape, 1e-3, np.float32))
    levels.stiffen(np.full(shape, 6, np.float32))
    pull = np.full(shape, 1, np.float32)
    moved = levels.precondition(pull, np.full(shape, 12, np.float32))
    assert moved.min() > 50 / 12
