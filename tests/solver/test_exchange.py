"""A frame that takes the place of another leaves what the new frames alone would have made."""

import numpy as np
import pytest

from solver import FusionOptions
from solver.geometry.positions import sample_positions
from solver.optimisation.footprint import AreaTerm
from solver.options import Footprint
from solver.preparation.prepare import exchange, prepare

FRAMES, ROWS, COLUMNS = 8, 12, 15


def stream(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances with gaps and amplitudes (N, H, W), and positions (N, H, W, 2), of which some are unknown."""
    rng = np.random.default_rng(4)
    distance = rng.uniform(1, 3, size=(count, ROWS, COLUMNS)).astype(np.float32)
    distance[rng.random(distance.shape) < 0.1] = np.nan
    amplitude = rng.uniform(0, 900, size=distance.shape).astype(np.float32)
    amplitude[rng.random(distance.shape) < 0.05] = 0
    positions = sample_positions(distance.shape, shifts=rng.uniform(-2, 2, size=(count, 2)))
    positions[rng.random(distance.shape) < 0.05] = np.nan
    return distance, amplitude, positions


def test_a_term_whose_frames_were_exchanged_is_that_of_the_new_ones() -> None:
    rng = np.random.default_rng(5)
    distance, amplitude, positions = stream(3 * FRAMES)
    weights = np.where(np.isfinite(distance), amplitude / 900, 0).astype(np.float32)
    values = np.stack([np.nan_to_num(distance), rng.normal(size=distance.shape).astype(np.float32)])
    old, new = slice(FRAMES), slice(2 * FRAMES, None)
    kept = values[:, old].copy(), weights[old].copy()
    term = AreaTerm(*kept, positions[old], 3, Footprint())
    x = rng.normal(size=(2, term.shape[1] + 4, term.shape[2] + 4)).astype(np.float32)
    value = term.value(x)
    for number in range(FRAMES, 3 * FRAMES):
        one = slice(number, number + 1)
        value += term.exchange(number % FRAMES, values[:, one], weights[one], positions[one], x)
    fresh = AreaTerm(values[:, new].copy(), weights[new].copy(), positions[new], 3, Footprint())
    found, expected = np.zeros_like(x), np.zeros_like(x)
    term.gradient(x, found)
    fresh.gradient(x, expected)
    np.testing.assert_allclose(found, expected, atol=3e-5 * np.abs(expected).max())
    assert term.value(x) == pytest.approx(fresh.value(x), rel=1e-6)
    assert value == pytest.approx(fresh.value(x), rel=1e-5)


@pytest.mark.parametrize("lit", [True, False])
def test_a_problem_whose_frames_were_exchanged_is_that_of_the_new_ones(lit: bool) -> None:
    distance, amplitude, positions = stream(9 * FRAMES)
    options = FusionOptions(method="area", amplitude_threshold=100.0)

    def prepared(frames: slice):  # type: ignore[no-untyped-def]
        light = amplitude[frames].copy() if lit else None
        where = positions[frames].copy()
        return prepare(distance[frames].copy(), light, where, options=options, noise=3.0)

    problem, fresh = prepared(slice(FRAMES)), prepared(slice(8 * FRAMES, None))
    usual = problem.usual_deviation
    for number in range(FRAMES, len(distance)):
        light = amplitude[number] if lit else None
        assert exchange(problem, number % FRAMES, distance[number], light, positions[number])
        assert problem.exchanged[0] == number % FRAMES
    np.testing.assert_array_equal(problem.distance, fresh.distance)
    np.testing.assert_array_equal(problem.sigma, fresh.sigma)
    fresh.usual_deviation = usual  # that of the first frames stays
    np.testing.assert_array_equal(problem.precision, fresh.precision)
    assert problem.usual_deviation == usual


def test_a_dark_frame_has_no_sample() -> None:
    distance, amplitude, positions = stream(FRAMES)
    options = FusionOptions(method="area", amplitude_threshold=100.0)
    problem = prepare(distance, amplitude, positions, options=options, noise=3.0)
    assert not exchange(problem, 2, distance[3], np.full_like(amplitude[3], 99), positions[3])
    assert np.isnan(problem.distance[2]).all()
