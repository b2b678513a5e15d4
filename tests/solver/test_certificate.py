"""The iteration against general convex solvers, on patches, in float64."""

import cvxpy as cp
import numpy as np
import pytest

from solver.geometry.positions import sample_positions
from solver.kernels.bound import correct, potential
from solver.optimisation.certificate import divergence
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.memory_gradient import Outcome, minimise
from solver.optimisation.prior import Prior, level
from solver.optimisation.sampling import SparseTerm
from solver.optimisation.term import Term, start
from solver.options import NEIGHBOURHOOD, Footprint

SHIFTS = np.array([[0, 0], [0.3, 0.45], [-0.4, 0.2], [0.15, -0.35]])


def prior_of(x: cp.Expression, rows: int, columns: int) -> cp.Expression:
    """Σ ‖∇x‖₂ of the vector x (rows · columns, channels), written out offset by offset."""
    index = np.arange(rows * columns).reshape(rows, columns)
    channels = x.shape[1]
    parts = []
    for down, right in NEIGHBOURHOOD:
        weight = 1 / np.hypot(down, right)
        source, target = [], []
        for i in range(rows):
            for j in range(columns):
                if i + down < rows and 0 <= j + right < columns:
                    source.append(index[i, j])
                    target.append(index[i + down, j + right])
        select = np.zeros((rows * columns, rows * columns))
        select[source, source] = weight
        select[source, target] = -weight
        parts += [select @ x[:, c] for c in range(channels)]
    return cp.sum(cp.norm(cp.vstack(parts), 2, axis=0))


def solve(objective: cp.Expression, solver: str) -> float:
    problem = cp.Problem(cp.Minimize(objective))
    settings = {"eps_abs": 1e-7, "eps_rel": 1e-7, "max_iters": 50000} if solver == "SCS" else {}
    problem.solve(solver=solver, **settings)
    assert problem.status == "optimal"
    return float(problem.value)


def run(term: Term, first: np.ndarray) -> Outcome:
    return minimise(term, Prior(), start(first), tolerance=1e-13, limit=10_000, rounding=1e-5)


@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
def test_sparse_term(solver: str) -> None:
    rng = np.random.default_rng(1)
    rows, columns = 12, 14
    weight = rng.integers(0, 3, (rows, columns)).astype(float)
    mean = np.where(
        weight > 0, np.where(np.arange(columns) < 7, 1.0, 4.0) + 0.3 * rng.normal(size=(rows, columns)), 0
    )
    constant = 2.5
    outcome = run(SparseTerm(weight, mean, constant), np.zeros((1, rows, columns)))

    x = cp.Variable((rows * columns, 1))
    data = cp.sum(cp.multiply(weight.ravel(), cp.square(x[:, 0] - mean.ravel()))) + constant
    best = solve(data + prior_of(x, rows, columns), solver)
    assert outcome.objective == pytest.approx(best, rel=1e-4)
    assert outcome.gap < 1e-4
    solution = outcome.state.x[0, 2:-2, 2:-2]
    np.testing.assert_allclose(solution[weight > 0], x.value.reshape(rows, columns)[weight > 0], atol=5e-3)


@pytest.mark.parametrize("channels", [1, 2], ids=["area", "phasor"])
@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
def test_footprint_term(solver: str, channels: int) -> None:
    rng = np.random.default_rng(2)
    height, width, factor = 4, 5, 3
    values = np.where(np.arange(width) < 2, 3.0, 8.0) + rng.normal(
        size=(channels, len(SHIFTS), height, width)
    )
    weights = rng.uniform(0.5, 1.5, values.shape[1:])
    weights[1, 2, 2] = 0
    positions = sample_positions((len(SHIFTS), height, width), shifts=SHIFTS)
    term = AreaTerm(values, weights, positions, factor, Footprint())
    _, rows, columns = term.shape
    outcome = run(term, np.full(term.shape, values.mean()))

    footprints, seen = averages(positions.reshape(-1, 2), factor, term.margin, rows, columns)
    weight, samples = weights.ravel()[seen], values.reshape(channels, -1)[:, seen]
    x = cp.Variable((rows * columns, channels))
    data = sum(
        cp.sum(cp.multiply(weight, cp.square(footprints @ x[:, c] - samples[c]))) for c in range(channels)
    )
    best = solve(data + prior_of(x, rows, columns), solver)
    assert outcome.objective == pytest.approx(best, rel=1e-4)
    assert outcome.gap < 1e-4
    inner = slice(2 + term.margin, -2 - term.margin)
    theirs = x.value.reshape(rows, columns, channels)
    cut = slice(term.margin, -term.margin)
    for c in range(channels):
        assert np.abs(outcome.state.x[c, inner, inner] - theirs[cut, cut, c]).mean() < 0.02


def averages(
    positions: np.ndarray, factor: int, margin: int, rows: int, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """The exact box averages over the map, one row per sample, and which samples lie inside it."""

    def overlap(at: float, size: int) -> np.ndarray:
        edges = np.arange(size)
        return np.clip(np.minimum(edges + 1, at + factor) - np.maximum(edges, at), 0, 1) / factor

    made, seen = [], np.zeros(len(positions), bool)
    for n, (y, x) in enumerate(positions.astype(float)):
        top, left = y * factor + margin, x * factor + margin
        if top < 0 or left < 0 or top + factor > rows or left + factor > columns:
            continue
        seen[n] = True
        made.append(np.outer(overlap(top, rows), overlap(left, columns)).ravel())
    return np.array(made), seen


def test_the_gap_bounds_the_error_long_before_convergence() -> None:
    rng = np.random.default_rng(3)
    weight = (rng.random((20, 20)) < 0.5).astype(float)
    mean = weight * rng.normal(size=(20, 20))
    best = run(SparseTerm(weight, mean, 0.0), np.zeros((1, 20, 20))).objective
    for limit in (1, 5, 20):
        early = minimise(
            SparseTerm(weight, mean, 0.0), Prior(), start(np.zeros((1, 20, 20))), tolerance=1e-9, limit=limit
        )
        assert early.gap >= (early.objective - best) / early.objective - 1e-9
        assert early.objective >= best * (1 - 1e-9)


def test_what_unseen_pixels_leave_goes_to_seen_ones_around() -> None:
    rng = np.random.default_rng(4)
    x, weight = rng.normal(size=(1, 44, 54)), (rng.random((44, 54)) < 0.4).astype(float)
    dual = Prior().duals(x, np.ones_like(x[0]), level(x), 1.0)
    before = divergence(dual, Prior().weights)[0]
    phi = potential(before, weight, 200)
    correct(0, 1, dual[0], phi, Prior().weights[:2].astype(float), np.full_like(x[0], 1e3))
    left = divergence(dual, Prior().weights)[0]
    unseen = weight[2:-2, 2:-2] == 0
    assert np.abs(before[unseen]).max() > 1
    np.testing.assert_allclose(left[unseen], 0, atol=1e-9)


def test_groups_are_brought_into_their_balls_one_by_one() -> None:
    x = np.random.default_rng(4).normal(size=(1, 14, 24))
    dual = Prior().duals(x, np.ones_like(x[0]), level(x), 1.0)
    given = dual.copy()
    radius = np.full_like(x[0], 0.9)
    radius[:, :12] = 2.0
    correct(0, 1, dual[0], np.zeros((12, 22)), Prior().weights[:2].astype(float), radius)
    norm = np.linalg.norm(dual[0], axis=0)
    assert np.all(norm <= radius * (1 + 1e-12))
    np.testing.assert_array_equal(dual[..., :12], given[..., :12])


def test_the_objective_never_rises() -> None:
    rng = np.random.default_rng(5)
    weight = (rng.random((30, 30)) < 0.4).astype(float)
    mean = 3 * weight * rng.normal(size=(30, 30))
    seen: list[float] = []
    minimise(
        SparseTerm(weight, mean, 0.0),
        Prior(),
        start(np.zeros((1, 30, 30))),
        tolerance=1e-9,
        limit=400,
        progress=lambda _, objective, __: seen.append(objective),
    )
    assert len(seen) > 10
    assert np.all(np.diff(seen) <= 1e-9 * seen[0])
