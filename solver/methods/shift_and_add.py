"""`shift-and-add`: every sample on the fused pixel under its centre, the median of those that meet.

    X(u) = median { D_k(i) : floor((p_k(i) + ½) β) = u }

The maximum-likelihood map under Laplacian noise before deblurring and interpolation. Source: Farsiu,
Robinson, Elad, Milanfar, "Fast and Robust Multiframe Super Resolution", IEEE TIP 13(10), 2004.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.preparation.problem import Problem, Solution
from solver.result import Progress

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Cells:
    """Samples sorted by the fused pixel they fall on.

    Attributes:
        samples: flat numbers of the samples in the frames.
        cell: flat number of each sample's fused pixel.
        shape: (βH, βW).
    """

    samples: NDArray[np.int64]
    cell: NDArray[np.int64]
    shape: tuple[int, int]

    def medians(self, values: Image) -> tuple[Image, NDArray[np.int64]]:
        """Median per fused pixel (NaN where no sample falls) and the number of samples; values (N, H, W)."""
        picked = values.reshape(-1)[self.samples]
        order = np.lexsort((picked, self.cell))
        cell, ranked = self.cell[order], picked[order]
        count = np.bincount(cell, minlength=self.shape[0] * self.shape[1])
        first = np.cumsum(count) - count
        seen = count > 0
        low, high = (first + (count - 1) // 2)[seen], (first + count // 2)[seen]
        result = np.full(count.size, np.nan, np.float32)
        result[seen] = 0.5 * (ranked[low] + ranked[high])
        return result.reshape(self.shape), count.reshape(self.shape)


def cells(problem: Problem) -> Cells:
    """Which fused pixel every valid sample falls on; those outside the grid are left out."""
    factor, shape = problem.options.upsampling, problem.fused_shape
    place = np.floor((problem.positions + np.float32(0.5)) * factor)
    inside = np.isfinite(problem.distance) & (place >= 0).all(-1)
    inside &= (place[..., 0] < shape[0]) & (place[..., 1] < shape[1])
    at = place[inside].astype(np.int64)
    return Cells(np.flatnonzero(inside), at[:, 0] * shape[1] + at[:, 1], shape)


def solve(problem: Problem, *, initial: Solution | None = None, progress: Progress | None = None) -> Solution:  # noqa: ARG001
    """Medians; fused pixels without a sample stay unknown, to be filled from the nearest."""
    found = cells(problem)
    distance, _ = found.medians(problem.distance)
    amplitude = None if problem.amplitude is None else found.medians(problem.amplitude)[0]
    return Solution(distance, amplitude, None, 0, None, None, True)
