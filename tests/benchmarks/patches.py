"""The LidarBoost paper's way to solve, patch by patch with a cone solver, against the whole map at once."""

import time
import warnings
from dataclasses import dataclass, replace

import cvxpy as cp
import numpy as np
from scipy import sparse

from solver import FusionOptions, fuse
from solver.evaluation import Trial
from solver.geometry.positions import sample_positions
from solver.optimisation.sampling import Samples, sample
from solver.options import NEIGHBOURHOOD

SIDE, OVERLAP = 20, 2  # fused pixels, the paper's
LARGE = 20  # low-resolution pixels: a patch of 80 × 80 fused pixels, solved whole by both
FACTOR = 4
SOLVERS = ("CLARABEL", "SCS")


@dataclass(frozen=True)
class Reference:
    """A cone solver on patches, from the mean time of some, against `lidarboost` on the same pixels at once.

    `seconds_per_patch` is modelling and solving, `inside_solver` the part that the solver itself reports.
    """

    solver: str
    side: int
    patches: int
    seconds_per_patch: float
    inside_solver: float
    ours: float

    @property
    def ratio(self) -> float:
        """Time of all patches over ours."""
        return self.seconds_per_patch * self.patches / self.ours

    @property
    def text(self) -> str:
        """One line."""
        inside = self.inside_solver * self.patches / self.ours
        return (
            f"CVXPY with {self.solver}, {self.patches} × ({self.side} × {self.side}): "
            f"{self.seconds_per_patch:.3f} s each, {self.inside_solver:.3f} s of it inside the solver; "
            f"lidarboost on the same pixels {1e3 * self.ours:.1f} ms: {self.ratio:,.0f} times as fast, "
            f"{inside:,.0f} times the solver alone"
        )


def compare_patches(trial: Trial, count: int) -> list[Reference]:
    """The paper's patches (`count` of them timed, spread over the map), then one large patch."""
    samples, strength, ours = _ours(trial)
    steps = [range(0, size - OVERLAP, SIDE - OVERLAP) for size in samples.mean.shape]
    corners = [(top, left) for top in steps[0] for left in steps[1]]
    picked = [corners[k] for k in np.linspace(0, len(corners) - 1, count).astype(int)]
    patches = [(slice(top, top + SIDE), slice(left, left + SIDE)) for top, left in picked]
    found = [_reference(solver, samples, patches, len(corners), SIDE, strength, ours) for solver in SOLVERS]
    middle = [slice((size - LARGE) // 2, (size + LARGE) // 2) for size in trial.distance.shape[1:]]
    part = replace(trial, distance=np.ascontiguousarray(trial.distance[:, middle[0], middle[1]]))
    samples, strength, ours = _ours(part)
    whole = [(slice(None), slice(None))]
    return found + [
        _reference(solver, samples, whole, 1, LARGE * FACTOR, strength, ours) for solver in SOLVERS
    ]


def _ours(trial: Trial) -> tuple[Samples, float, float]:
    """The data term, the λ of `auto`, and the least of five times of the solve."""
    positions = sample_positions(trial.distance.shape, shifts=trial.shifts)
    samples = sample(trial.distance, np.ones_like(trial.distance), positions, FACTOR)
    options = FusionOptions(method="lidarboost", upsampling=FACTOR)
    reports = [fuse(trial.distance, options=options, shifts=trial.shifts).report for _ in range(6)]
    return samples, reports[0].regularization, min(report.seconds.solve for report in reports[1:])


def _reference(
    solver: str,
    samples: Samples,
    patches: list[tuple[slice, slice]],
    total: int,
    side: int,
    strength: float,
    ours: float,
) -> Reference:
    seconds, inside = [], []
    for patch in patches:
        begin = time.perf_counter()
        inside.append(solve_patch(samples.weight[patch], samples.mean[patch], strength, solver))
        seconds.append(time.perf_counter() - begin)
    return Reference(solver, side, total, float(np.mean(seconds)), float(np.mean(inside)), ours)


def solve_patch(weight: np.ndarray, mean: np.ndarray, strength: float, solver: str) -> float:
    """Minimise Σ w (x − m)² + λ Σ ‖∇x‖₂ over a patch; returns the seconds that the solver reports."""
    shape = weight.shape
    x = cp.Variable(weight.size)
    groups = cp.vstack([_difference(shape, offset) @ x for offset in NEIGHBOURHOOD])
    data = cp.sum_squares(cp.multiply(np.sqrt(weight.ravel()), x - mean.ravel()))
    problem = cp.Problem(cp.Minimize(data + strength * cp.sum(cp.norm(groups, 2, axis=0))))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.solve(solver=solver)
    return float(problem.solver_stats.solve_time)


def _difference(shape: tuple[int, int], offset: tuple[int, int]) -> sparse.csr_array:
    """(X(u, v) − X(u + l, v + m)) / √(l² + m²), one row a pixel, empty where the neighbour is outside."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    here = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(offset, shape, strict=True))
    there = tuple(slice(max(0, d), n + min(0, d)) for d, n in zip(offset, shape, strict=True))
    row, other = number[here].ravel(), number[there].ravel()
    value = np.full(row.size, 1 / np.hypot(*offset))
    entries = (np.concatenate([value, -value]), (np.concatenate([row, row]), np.concatenate([row, other])))
    return sparse.csr_array(entries, shape=(number.size, number.size))
