"""The iteration that goes on, on other data, where one before it ended."""

from collections.abc import Callable

import numpy as np
import pytest

from solver.geometry.positions import sample_positions
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.memory_gradient import minimise
from solver.optimisation.prior import Prior
from solver.optimisation.sampling import SparseTerm
from solver.optimisation.term import Term, start
from solver.options import Footprint

FRAMES, ROWS, COLUMNS, FACTOR = 6, 16, 20, 2


def area(weight: float) -> Term:
    """Samples of a coarse checkerboard, of so much weight each."""
    shifts = np.random.default_rng(3).uniform(-1, 1, (FRAMES, 2))
    positions = sample_positions((FRAMES, ROWS, COLUMNS), shifts=shifts)
    values = 10 * np.floor(positions[..., 0] / 5 + np.floor(positions[..., 1] / 5)) % 2
    weights = np.full(values.shape, weight, np.float32)
    return AreaTerm(values[None].astype(np.float32), weights, positions, FACTOR, Footprint())


def sparse(weight: float) -> Term:
    """A checkerboard of samples without gaps."""
    y, x = np.mgrid[: FACTOR * ROWS, : FACTOR * COLUMNS]
    mean = (10.0 * ((y // 9 + x // 9) % 2)).astype(np.float32)
    return SparseTerm(np.full(mean.shape, weight, np.float32), mean, 0.0)


@pytest.mark.parametrize("term", [area, sparse])
@pytest.mark.parametrize(("growth", "iterations"), [(2.0, 1), (1.5, 2)])
def test_data_that_hold_a_map_ever_harder_never_make_the_objective_rise(
    term: Callable[[float], Term], growth: float, iterations: int
) -> None:
    prior, memory, weight = Prior(), None, 0.01
    noise = np.random.default_rng(4).normal(size=(1, FACTOR * ROWS, FACTOR * COLUMNS))
    state = start(10 * noise.astype(np.float32))
    for _ in range(30):
        data, state.fit = term(weight), None
        before = data.value(state.x) + prior.value(state.x, state.radius, state.slope)
        outcome = minimise(data, prior, state, tolerance=1e-9, limit=iterations, certify=False, memory=memory)
        assert outcome.objective <= (1 + 1e-4) * before
        memory = outcome.memory
        weight *= growth
