"""The methods that others published: what each must do, and that it minimises what it says."""

from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from solver import FusionOptions, fuse
from solver.evaluation import DepthMap, errors, make_trial, procedural_object
from solver.geometry.positions import sample_positions
from solver.methods import ibsr, mrf, shift_and_add
from solver.optimisation import stencil as stencil_systems
from solver.optimisation.sampling import sample
from solver.optimisation.stencil import conjugate_gradients
from solver.preparation.prepare import prepare

SHARED = Path(__file__).parents[3] / "shared" / "data"


def problem(distance, shifts, noise=None, **options):
    frames = np.asarray(distance, np.float32)
    positions = sample_positions(frames.shape, shifts=shifts)
    return prepare(frames, None, positions, options=FusionOptions(**options), noise=noise)


def run(method, distance, shifts=None, **options):
    shifts = np.zeros((len(distance), 2)) if shifts is None else shifts
    return fuse(distance, options=FusionOptions(method=method, **options), shifts=shifts)


def test_bicubic_reproduces_a_quadratic_surface_away_from_the_border():
    def surface(r, c):
        return 2 + 0.1 * r - 0.05 * c + 0.01 * r * c + 0.004 * r * r

    rows, columns = np.indices((12, 14))
    fused = run("bicubic", surface(rows, columns)[None].astype(np.float32), upsampling=4)
    fine = (np.indices((48, 56)) + 0.5) / 4 - 0.5
    inner = (slice(8, -8), slice(8, -8))
    assert np.allclose(fused.distance[inner], surface(*fine)[inner], atol=1e-5)
    assert fused.report.regularization is None


def test_bicubic_takes_the_frame_nearest_to_the_grid_and_follows_its_shift():
    rows, columns = np.indices((12, 14))
    ramp = (rows + 0.5 * columns).astype(np.float32)
    fused = run("bicubic", np.stack([ramp + 0.25, ramp * 0 + 9]), [[0.25, 0], [3, 3]], upsampling=2)
    fine = (np.indices((24, 28)) + 0.5) / 2 - 0.5
    inner = (slice(4, -4), slice(4, -4))
    assert np.allclose(fused.distance[inner], (fine[0] + 0.5 * fine[1])[inner], atol=1e-5)


def test_bicubic_leaves_missing_pixels_to_the_filling_and_does_not_smear_them():
    distance = np.full((1, 10, 10), 3.0, np.float32)
    distance[0, 4, 5] = np.nan
    fused = run("bicubic", distance, upsampling=3, fill=0.5)
    assert np.isnan(fused.distance[13, 16])
    assert np.allclose(fused.distance[np.isfinite(fused.distance)], 3)


def test_shift_and_add_takes_the_median_of_the_samples_on_each_fused_pixel():
    distance = np.stack([np.full((6, 6), value) for value in (1.0, 2.0, 50.0, 7.0)])  # of any noise
    shifts = [[0, 0], [0.1, 0], [0, 0.1], [0.5, 0.5]]
    solution = shift_and_add.solve(problem(distance, shifts, noise=20.0, upsampling=2))
    assert solution.distance[3, 3] == 2  # of 1, 2 and 50: floor((1 + ½ + shift) · 2) = 3
    assert solution.distance[4, 4] == 7
    assert np.isnan(solution.distance[3, 4])
    pair = shift_and_add.solve(problem(distance[:2], shifts[:2], upsampling=2))
    assert pair.distance[3, 3] == 1.5


def test_shift_and_add_ignores_samples_beyond_the_grid():
    solution = shift_and_add.solve(problem(np.ones((2, 4, 4)), [[0, 0], [3, -9]], upsampling=2))
    assert np.isfinite(solution.distance).sum() == 16


def test_the_descent_direction_of_ibsr_is_the_slope_of_its_objective():
    random = np.random.default_rng(0)
    image, target = random.normal(size=(2, 14, 15)).astype(np.float32) * 50
    root = np.sqrt(random.integers(0, 4, image.shape)).astype(np.float32)
    slope = ibsr._slope(image, target, root, 0.3)
    for place in ((0, 0), (7, 8), (13, 14), (3, 12)):
        step = np.zeros_like(image)
        step[place] = 0.01
        change = ibsr._objective(image + step, target, root, 0.3) - ibsr._objective(
            image - step, target, root, 0.3
        )
        assert slope[place] == pytest.approx(change / 0.02, abs=0.03)


def test_ibsr_works_in_the_papers_range_whatever_the_unit():
    trial = make_trial(DepthMap(procedural_object(), oversampling=2), variance=4.1, seed=0)
    metres = run("ibsr", trial.distance / 100 + 2, trial.shifts)
    paper = run("ibsr", trial.distance, trial.shifts)
    # Rounding decides the sign of differences near zero, so the two descents wander apart, but not away.
    there = errors((metres.distance - 2) * 100, trial.truth).mse
    assert there == pytest.approx(errors(paper.distance, trial.truth).mse, rel=0.01)
    assert paper.report.regularization == pytest.approx(metres.report.regularization, rel=1e-3)
    assert 0.02 < paper.report.regularization < 0.022  # little noise
    assert paper.report.iterations == 50
    assert paper.report.converged


@pytest.mark.skipif(not (SHARED / "bunny_depth.npz").exists(), reason="needs shared data")
@pytest.mark.parametrize("variance", [0, 4.1, 46.3])
def test_ibsr_at_the_papers_settings(variance):
    with np.load(SHARED / "bunny_depth.npz") as data:
        trial = make_trial(DepthMap(data["fine"], oversampling=4), variance=variance, seed=0)
    frame = errors(run("nearest", trial.distance, trial.shifts).distance, trial.truth).mse
    paper, automatic = (
        errors(run("ibsr", trial.distance, trial.shifts, regularization=strength).distance, trial.truth).mse
        for strength in (0.04, "auto")
    )
    assert 0.3 < paper / frame < 0.65
    assert automatic < 1.05 * paper


def test_ibsr_flattens_a_constant_scene_to_itself():
    assert np.allclose(run("ibsr", np.full((3, 8, 8), 2.5)).distance, 2.5)


@pytest.mark.parametrize("guided", [False, True])
def test_mrf_solves_its_linear_system(guided):
    random = np.random.default_rng(1)
    distance = random.normal(3, 1, (3, 7, 6)).astype(np.float32)
    distance[1, 2, 3] = np.nan
    shifts = [[0, 0], [0.3, -0.2], [-0.6, 0.4]]
    guide = random.uniform(size=(14, 12)).astype(np.float32) if guided else None
    options = FusionOptions(method="mrf", upsampling=2, regularization=0.5, tolerance=1e-5)
    positions = sample_positions(distance.shape, shifts=shifts)
    found = mrf.solve(prepare(distance, None, positions, options=options, guide=guide))

    used = np.isfinite(distance)
    samples = sample(distance, used.astype(np.float32), positions, 2)
    size = samples.weight.size
    number = np.arange(size).reshape(14, 12)
    matrix = sparse.diags_array(samples.weight.ravel().astype(float)).tolil()
    scaled = None
    if guide is not None:
        low, high = np.percentile(guide, (1, 99))
        scaled = ((guide - low) / (high - low)).ravel().astype(float)
    pairs = [*zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    pairs += zip(number[:-1].ravel(), number[1:].ravel(), strict=True)
    for u, v in pairs:
        link = (
            0.5
            if scaled is None
            else 0.5 * max(np.exp(-0.5 * ((scaled[u] - scaled[v]) / mrf.EDGE) ** 2), 1e-3)
        )
        matrix[u, u] += link
        matrix[v, v] += link
        matrix[u, v] -= link
        matrix[v, u] -= link
    expected = spsolve(matrix.tocsr(), (samples.weight * samples.mean).ravel().astype(float))
    assert np.allclose(found.distance.ravel(), expected, atol=2e-3)

    x = expected
    cell = np.floor((positions + 0.5) * 2)
    inside = used & (cell >= 0).all(axis=-1) & (cell < [14, 12]).all(axis=-1)
    data = float((distance[inside].astype(float) ** 2).sum())
    right = (samples.weight * samples.mean).ravel().astype(float)
    assert found.objective == pytest.approx(x @ (matrix @ x) - 2 * right @ x + data, rel=1e-3)


def test_mrf_keeps_an_edge_where_the_guide_has_one_and_blurs_it_elsewhere():
    distance = np.where(np.arange(12) < 6, 1.0, 2.0) * np.ones((1, 12, 1))
    guide = np.where(np.arange(48) < 24, 0.2, 0.8) * np.ones((48, 1))
    options = FusionOptions(method="mrf", regularization=4.0)
    sharp = fuse(distance, options=options, guide=guide).distance
    blurred = fuse(distance, options=options).distance
    assert sharp[20, 23] == pytest.approx(1, abs=0.02)
    assert sharp[20, 24] == pytest.approx(2, abs=0.02)
    assert abs(blurred[20, 24] - blurred[20, 23]) < 0.3


def test_mrf_is_guided_by_the_fused_amplitude_where_no_photograph_is_given():
    distance = np.where(np.arange(12) < 6, 1.0, 2.0) * np.ones((3, 12, 1))
    amplitude = np.where(np.arange(12) < 6, 900.0, 300.0) * np.ones((3, 12, 1))
    shifts = [[0, 0], [0.25, 0], [0.5, 0]]
    fused = fuse(
        distance, amplitude, options=FusionOptions(method="mrf", amplitude_threshold=0), shifts=shifts
    )
    assert fused.amplitude is not None
    assert fused.amplitude.shape == (48, 48)
    assert np.abs(fused.amplitude[10:40, 10] - 900).max() < 60
    assert fused.distance[20, 18] == pytest.approx(1, abs=0.02)
    assert fused.distance[20, 29] == pytest.approx(2, abs=0.02)


@pytest.mark.parametrize("method", ["nearest", "bicubic", "shift-and-add", "ibsr", "mrf"])
@pytest.mark.parametrize("factor", [1, 3])
def test_every_classic_method_gives_back_a_constant_scene(method, factor):
    distance = np.full((3, 9, 11), 4.0, np.float32)
    distance[1, 2:5, 3] = np.nan
    fused = run(method, distance, [[0, 0], [0.4, -0.3], [-0.7, 0.6]], upsampling=factor)
    assert fused.distance.shape == (9 * factor, 11 * factor)
    assert np.allclose(fused.distance, 4, atol=1e-4)


@pytest.mark.parametrize("creeping", [0, 3, 100])
def test_conjugate_gradients_agree_with_a_dense_solution(monkeypatch, creeping):
    monkeypatch.setattr(stencil_systems, "_CREEPING", creeping)
    random = np.random.default_rng(2)
    stencil = np.zeros((3, 6, 7), np.float32)
    stencil[1, :, :-1] = random.normal(size=(6, 6))
    stencil[2, :-1] = random.normal(size=(5, 7))
    number = np.arange(42).reshape(6, 7)
    dense = np.zeros((42, 42))
    for coefficient, (dy, dx) in zip(stencil[1:], ((0, 1), (1, 0)), strict=True):
        for i in range(6 - dy):
            for j in range(7 - dx):
                dense[number[i, j], number[i + dy, j + dx]] = coefficient[i, j]
    dense += dense.T
    stencil[0] = (np.abs(dense).sum(axis=1) + 1).reshape(6, 7)
    dense += np.diag(stencil[0].ravel())
    right = random.normal(size=(6, 7)).astype(np.float32)
    found, steps = conjugate_gradients(stencil, right, np.zeros_like(right), steps=200, tolerance=1e-6)
    assert steps < 30
    assert np.allclose(found.ravel(), np.linalg.solve(dense, right.ravel()), atol=1e-5)
