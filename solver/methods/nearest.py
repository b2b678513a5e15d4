"""`nearest`: one frame, each pixel repeated β × β times: what superresolution has to beat."""

import numpy as np
from numpy.typing import NDArray

from solver.preparation.problem import Problem, Solution
from solver.result import Progress


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:  # noqa: ARG001
    """Enlarge the frame that lies nearest to the grid of frame 0, without any averaging."""
    rows, columns = problem.distance.shape[1:]
    best, displacement = frame_at_grid(problem)
    source = sources(displacement, problem.options.upsampling)
    inside = (source >= 0).all(-1) & (source[..., 0] < rows) & (source[..., 1] < columns)
    row, column = np.where(inside, source[..., 0], 0), np.where(inside, source[..., 1], 0)
    distance = np.where(inside, problem.distance[best][row, column], np.float32(np.nan))
    amplitude = None
    if problem.amplitude is not None:
        amplitude = np.where(inside, problem.amplitude[best][row, column], np.float32(np.nan))
    return Solution(distance, amplitude, None, 0, None, None, True)


def frame_at_grid(problem: Problem) -> tuple[int, NDArray[np.float32]]:
    """Number of the frame nearest to the grid, and how far each of its pixels looks from its own place."""
    grid = np.moveaxis(np.indices(problem.distance.shape[1:], np.float32), 0, -1)
    away = np.nanmean(np.abs(problem.positions - grid), axis=(1, 2, 3))
    best = int(np.nanargmin(away))
    return best, problem.positions[best] - grid


def sources(displacement: NDArray[np.float32], factor: int) -> NDArray[np.int64]:
    """(βH, βW, 2): the frame's pixel nearest to each fused pixel's centre; positions vary slowly."""
    rows, columns = displacement.shape[:2]
    fine = displacement.repeat(factor, axis=0).repeat(factor, axis=1)
    cells = np.moveaxis(np.indices((rows * factor, columns * factor), np.float32), 0, -1)
    centre = (cells + 0.5) / factor - 0.5
    return np.asarray(np.floor(centre - fine + 0.5), np.int64)
