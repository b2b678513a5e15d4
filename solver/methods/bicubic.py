"""`bicubic`: one frame enlarged by cubic convolution: smooth, but no more detail than the frame has.

    X(p) = Σ_q κ(p_y − q_y) κ(p_x − q_x) D(q) over 4 × 4 pixels q, κ Keys' kernel with a = −½.

Source: R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE TASSP 29(6), 1981.
"""

import numpy as np
from numpy.typing import NDArray

from solver.methods.nearest import frame_at_grid, sources
from solver.optimisation.fill import nearest
from solver.preparation.problem import Problem, Solution
from solver.result import Progress

Image = NDArray[np.float32]


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:  # noqa: ARG001
    """Enlarge the frame nearest to the grid of frame 0; unknown where its nearest pixel is not valid."""
    rows, columns = problem.distance.shape[1:]
    best, displacement = frame_at_grid(problem)
    whole = sources(displacement, problem.options.upsampling)
    inside = (whole >= 0).all(-1) & (whole[..., 0] < rows) & (whole[..., 1] < columns)
    row, column = np.where(inside, whole[..., 0], 0), np.where(inside, whole[..., 1], 0)
    valid = np.isfinite(problem.distance[best])
    known = inside & valid[row, column]
    place = _places(displacement, problem.options.upsampling)
    distance = _interpolated(problem.distance[best], valid, place)
    amplitude = None
    if problem.amplitude is not None:
        light = problem.amplitude[best]
        amplitude = np.where(known, _interpolated(light, np.isfinite(light), place), np.float32(np.nan))
    return Solution(np.where(known, distance, np.float32(np.nan)), amplitude, None, 0, None, None, True)


def _places(displacement: Image, factor: int) -> Image:
    """(βH, βW, 2): where the centre of each fused pixel lies in the frame, in its pixels."""
    rows, columns = displacement.shape[:2]
    fine = displacement.repeat(factor, axis=0).repeat(factor, axis=1)
    cells = np.moveaxis(np.indices((rows * factor, columns * factor), np.float32), 0, -1)
    return np.asarray((cells + 0.5) / np.float32(factor) - 0.5 - fine, np.float32)


def _interpolated(image: Image, valid: NDArray[np.bool_], place: Image) -> Image:
    """Cubic convolution at places (…, 2), edges repeated, missing pixels taken from the nearest valid one."""
    if not valid.any():
        return np.full(place.shape[:-1], np.nan, np.float32)
    whole = nearest(np.where(valid, image, 0).astype(np.float32), valid)
    rows, columns = image.shape
    corner = np.floor(place).astype(np.int64)
    part = place - corner.astype(np.float32)
    down, across = _keys(part[..., 0]), _keys(part[..., 1])
    result = np.zeros(place.shape[:-1], np.float32)
    for i in range(4):
        r = np.clip(corner[..., 0] + i - 1, 0, rows - 1)
        line = np.zeros_like(result)
        for j in range(4):
            line += across[j] * whole[r, np.clip(corner[..., 1] + j - 1, 0, columns - 1)]
        result += down[i] * line
    return result


def _keys(t: Image) -> tuple[Image, Image, Image, Image]:
    """Weights of the pixels at −1, 0, 1 and 2 for a place at t between 0 and 1."""
    return (
        ((-0.5 * t + 1) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1,
        ((-1.5 * t + 2) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )
