"""Sweeps over a mosaic's equations get nearer to their solution, by any number of threads."""

import numba
import numpy as np

from solver.evaluation import DepthMap, make_trial, procedural_object
from solver.registration.equations import POSITION_ERROR, normal_equations
from solver.registration.grid import Grid
from solver.registration.motion import Shift
from solver.registration.placement import DENSITY, SMOOTHING
from solver.registration.point_samples import Points
from solver.registration.samples import Samples, scaling
from solver.registration.sums import Sums
from solver.registration.sweep import EPSILON, sweep, sweep_and_fade


def test_a_sweep_that_fades_is_a_sweep_and_lowers_what_is_minimised():
    depth = DepthMap(procedural_object(), oversampling=2)
    trial = make_trial(depth, variance=0.7, seed=2)
    samples = scaling(trial.distance[:3], None, None)(trial.distance[:3], None)
    points = Points.of(samples, Shift().base(samples), np.ones(3, np.bool_))
    place = Shift().place(points, np.pad(trial.shifts[:3], ((0, 0), (0, 1))))
    sums = Sums(Grid.over(place, points.shape, DENSITY), points.values.shape[1])
    sums.add(points, place)
    image = sums.solve(smoothing=SMOOTHING, sweeps=1).values.copy()
    rest = np.random.default_rng(1).normal(size=sums.images.shape).astype(np.float32)
    expected = np.empty_like(image)
    sweep(sums.images, image, expected, SMOOTHING, DENSITY)
    faded = np.float32(0.9) * sums.images + (np.float32(1) - np.float32(0.9)) * rest
    threads = numba.get_num_threads()
    try:
        for count in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(count)
            images, found = sums.images.copy(), np.empty_like(image)
            sweep_and_fade(images, image, found, SMOOTHING, DENSITY, 0.9, rest)
            np.testing.assert_array_equal(found, expected)
            np.testing.assert_allclose(images, faded, atol=1e-6 * np.abs(faded).max())
    finally:
        numba.set_num_threads(threads)
    once, twice = (_misfit(sums.images, u) for u in (image, expected))
    assert twice < once


def test_samples_that_look_nowhere_count_for_nothing():
    """A lens may image a ray far outside its field at infinity, or at no place at all."""
    shape, rng = (12, 15), np.random.default_rng(1)
    samples = Samples(
        rng.normal(size=(1, 1, *shape)).astype(np.float32), np.ones((1, *shape), np.float32), 0, bent=True
    )
    points = Points.of(samples, Shift().base(samples), np.ones(1, np.bool_))
    row, column = points.row.copy(), points.column.copy()
    row[3], column[40], row[77], column[78] = np.nan, np.nan, np.inf, -np.inf
    seen = np.isfinite(row) & np.isfinite(column)
    grid = Grid.over((row, column), shape, DENSITY)
    assert grid == Grid.over((row[seen], column[seen]), shape, DENSITY)
    samples.weights.ravel()[~seen] = 0
    fewer = Points.of(samples, Shift().base(samples), np.ones(1, np.bool_))
    found, expected = Sums(grid, 1), Sums(grid, 1)
    found.add(points, (row, column))
    expected.add(fewer, (row[seen], column[seen]))
    np.testing.assert_array_equal(found.images, expected.images)
    mosaic = expected.solve(smoothing=SMOOTHING, sweeps=1)
    equations = normal_equations(points, (row, column), mosaic, Shift(), POSITION_ERROR)
    others = normal_equations(fewer, (row[seen], column[seen]), mosaic, Shift(), POSITION_ERROR)
    np.testing.assert_array_equal(equations.matrix, others.matrix)
    np.testing.assert_array_equal(equations.right, others.right)


def test_sweeps_over_few_samples_settle():
    random = np.random.default_rng(0)
    count, shape = 60, (16, 12)
    row, column = (random.uniform(0, (n - 1) / DENSITY, count).astype(np.float32) for n in shape)
    values, weights = random.normal(size=(count, 1)).astype(np.float32), np.full(count, 1e3, np.float32)
    first, pixel = np.array([0, count]), np.zeros(count, np.int32)
    points = Points(values, weights, row, column, pixel, first, shape, level=0, bent=True)
    sums = Sums(Grid((0.0, 0.0), shape, DENSITY), channels=1)
    sums.add(points, (row, column))
    image = np.zeros((1, *shape), np.float32)
    before, into = np.inf, image.copy()
    for _ in range(200):
        sweep(sums.images, image, into, SMOOTHING, DENSITY)
        image, into = into, image
        after = _misfit(sums.images, image)
        assert after <= before + 1e-3 * abs(after)
        before = after


def _misfit(sums, image):
    """Uᵀ M U − 2 bᵀ U + 2 λ Σ √(|∇U|² + ε²) of a mosaic U (C, rows, columns)."""
    S, b = sums[:5].astype(float), sums[5:].astype(float)
    u = image.astype(float)
    pairs = u[:, :, :-1] * u[:, :, 1:], u[:, :-1] * u[:, 1:]
    diagonals = u[:, :-1, :-1] * u[:, 1:, 1:], u[:, :-1, 1:] * u[:, 1:, :-1]
    value = (S[0] * u * u).sum() - 2 * (b * u).sum()
    value += 2 * (S[1, :, :-1] * pairs[0]).sum() + 2 * (S[2, :-1] * pairs[1]).sum()
    value += 2 * (S[3, :-1, :-1] * diagonals[0]).sum() + 2 * (S[4, :-1, 1:] * diagonals[1]).sum()
    down, across = np.diff(u, axis=1) ** 2, np.diff(u, axis=2) ** 2
    square = np.pad(down, ((0, 0), (1, 0), (0, 0))) + np.pad(down, ((0, 0), (0, 1), (0, 0)))
    square += np.pad(across, ((0, 0), (0, 0), (1, 0))) + np.pad(across, ((0, 0), (0, 0), (0, 1)))
    return value + 2 * SMOOTHING * np.sqrt(0.5 * square.sum(axis=0) + (EPSILON / DENSITY) ** 2).sum()
