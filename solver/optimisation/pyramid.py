"""A start for the sparse data term: the same problem on coarser grids, from the coarsest on.

What is far from any sample, or noisy over a large area, is settled where it is a few pixels wide: one step
on the fused grid carries a value two pixels far. On a grid of cells of s × s pixels the samples of a cell are
one with the sum of their weights, and a difference of neighbours stands for s² pixels with an s-th of it
each, so λ becomes s λ. Source of the idea, nested iteration: Brandt, "Multi-level adaptive solutions to
boundary-value problems", Math. Comp. 1977.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.optimisation.fill import smoothed
from solver.optimisation.memory_gradient import minimise
from solver.optimisation.padding import cropped
from solver.optimisation.prior import Prior
from solver.optimisation.sampling import SparseTerm
from solver.optimisation.term import State, start
from solver.runtime.threads import enough_threads

_LEAST = 4
"""Cells across the shorter side of the coarsest grid."""

_TOLERANCE, _LIMIT = 0.1, 400
"""In units of the tolerance on the fused grid; the most iterations on one grid."""

_EASY = 50
"""Iterations on the frames' own grid up to which the fused one needs no grid between them."""

_BLUNTER = 48.0
"""Factor on the ε of the last coarse grid, on which differences are as many times as large as its cells are
wide: sharper, a map has a per cent more mean absolute error, blunter, more iterations go by in blunting."""


def coarse_start(
    mean: NDArray[np.float32], weight: NDArray[np.float32], factor: int, prior: Prior, tolerance: float
) -> State:
    """A state of the map (βH, βW) near the minimum of Σ w (x − m)² + Σ ‖∇x‖₂.

    Args:
        mean, weight: (βH, βW), of the samples on each pixel, in units of λ; weight 0 = none.
        factor: β.
        prior: the operator ∇.
        tolerance: relative error of the objective that is asked of the fused grid.
    """
    grids, iterations = _grids(weight, weight * mean), 0
    found: NDArray[np.float32] | None = None
    epsilon = 0.0
    for level in range(len(grids) - 1, 0, -1):
        side = 2**level
        if side < factor and iterations <= _EASY:
            break
        cells, sums = grids[level]
        means = np.asarray(sums / np.where(cells > 0, cells, np.float32(1)), np.float32)
        first = (
            smoothed(means, cells, max(1, factor // side)) if found is None else _finer(found, cells.shape)
        )
        state = start(first[None])
        state.radius *= np.float32(side)
        term, own = SparseTerm(cells, means, 0.0), _TOLERANCE * tolerance
        with enough_threads(cells.size):
            outcome = minimise(term, prior, state, tolerance=own, limit=_LIMIT, certify=False)
        iterations = outcome.iterations
        found = cropped(outcome.state.x, cells.shape)[0].astype(np.float32)
        epsilon = min(1.0, _BLUNTER / side * outcome.state.epsilon)
    first = smoothed(mean, weight, factor) if found is None else _finer(found, weight.shape)
    return replace(start(first[None]), epsilon=epsilon)


def _grids(*images: NDArray[np.float32]) -> list[tuple[NDArray[np.float32], ...]]:
    """The images, and their sums over cells of 2 × 2, 4 × 4, … pixels down to the coarsest grid."""
    grids = [images]
    while min(grids[-1][0].shape) >= 2 * _LEAST:
        grids.append(tuple(_halved(image) for image in grids[-1]))
    return grids


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums over cells of 2 × 2 pixels; the last ones may be cut."""
    rows, columns = image.shape
    even = cv2.copyMakeBorder(image, 0, rows % 2, 0, columns % 2, cv2.BORDER_CONSTANT)
    size = even.shape[1] // 2, even.shape[0] // 2
    return np.asarray(4 * cv2.resize(even, size, interpolation=cv2.INTER_AREA), np.float32)


def _finer(image: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Interpolated between the cells' centres, on a grid whose pixels are a power of two smaller."""
    ratio = 1
    while image.shape[0] * ratio < shape[0]:
        ratio *= 2
    size = image.shape[1] * ratio, image.shape[0] * ratio
    large = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.float32)
    found: NDArray[np.float32] = np.ascontiguousarray(large[: shape[0], : shape[1]])
    return found
