"""A start for the sparse data term: the same problem on coarser grids, from the coarsest on.

What is far from any sample, or noisy over a large area, is settled where it is a few pixels wide: one step
on the fused grid carries a value two pixels far. On a grid of cells of s × s pixels the samples of a cell are
one with the sum of their weights, and a difference of neighbours stands for s² pixels with an s-th of it
each, so λ becomes s λ. Source of the idea, nested iteration: Brandt, "Multi-level adaptive solutions to
boundary-value problems", Math. Comp. 1977.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.optimisation.fill import smoothed
from solver.optimisation.memory_gradient import minimise
from solver.optimisation.padding import cropped
from solver.optimisation.prior import Prior
from solver.optimisation.sampling import SparseTerm
from solver.optimisation.term import start

_LEAST = 4
"""Cells across the shorter side of the coarsest grid."""

_TOLERANCE, _LIMIT = 0.1, 400
"""In units of the tolerance on the fused grid; the most iterations on one grid."""

_EASY = 50
"""Iterations on the frames' own grid up to which the fused one needs no grid between them."""


def coarse_start(
    mean: NDArray[np.float32], weight: NDArray[np.float32], factor: int, prior: Prior, tolerance: float
) -> NDArray[np.float32]:
    """A map (βH, βW) near the minimum of Σ w (x − m)² + Σ ‖∇x‖₂.

    Args:
        mean, weight: (βH, βW), of the samples on each pixel, in units of λ; weight 0 = none.
        factor: β.
        prior: the operator ∇.
        tolerance: relative error of the objective that is asked of the fused grid.
    """
    side = max(1, 2 ** int(np.log2(min(weight.shape) / _LEAST)))
    found: NDArray[np.float32] | None = None
    iterations = 0
    while side > 1 and (side >= factor or iterations > _EASY):
        cells = _cells(weight, side)
        means = (_cells(weight * mean, side) / np.where(cells > 0, cells, 1)).astype(np.float32)
        first = (
            smoothed(means, cells, max(1, factor // side)) if found is None else _finer(found, cells.shape)
        )
        state = start(first[None])
        state.radius *= np.float32(side)
        term = SparseTerm(cells, means, 0.0)
        outcome = minimise(term, prior, state, tolerance=_TOLERANCE * tolerance, limit=_LIMIT, certify=False)
        iterations = outcome.iterations
        found = cropped(outcome.state.x, cells.shape)[0].astype(np.float32)
        side //= 2
    return smoothed(mean, weight, factor) if found is None else _finer(found, weight.shape)


def _cells(image: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Sums over cells of side × side pixels; the last ones may be cut."""
    rows, columns = (-(-n // side) for n in image.shape)
    whole = np.zeros((rows * side, columns * side), np.float32)
    whole[: image.shape[0], : image.shape[1]] = image
    return np.asarray(whole.reshape(rows, side, columns, side).sum((1, 3)), np.float32)


def _finer(image: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Interpolated between the cells' centres, on a grid whose pixels are a power of two smaller."""
    ratio = 1
    while image.shape[0] * ratio < shape[0]:
        ratio *= 2
    size = image.shape[1] * ratio, image.shape[0] * ratio
    large = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.float32)
    found: NDArray[np.float32] = np.ascontiguousarray(large[: shape[0], : shape[1]])
    return found
