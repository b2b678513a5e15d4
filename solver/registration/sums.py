"""The normal equations of a mosaic, which samples may be added to, and their solution."""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels.nodes import accumulate
from solver.registration.grid import Grid, Place
from solver.registration.mosaic import Mosaic
from solver.registration.point_samples import Points
from solver.registration.steepness import Mask, node_kinds, quantile, thinned
from solver.registration.sweep import sweep
from solver.runtime import team

Image = NDArray[np.float32]

COLD = 4  # sweeps from a blurred start; two are enough from an earlier mosaic
COVERED = 0.1  # of the median weight around a node, from which on it counts as seen


class Sums:
    """The normal equations of samples on a grid, which samples may be added to; kept, they are memory ready.

    Args:
        grid: where the nodes are.
        channels: C of the samples' values.
    """

    def __init__(self, grid: Grid, channels: int) -> None:
        self.grid = grid
        # The stencil's five images (see `sweep`) and the right sides.
        self.images = np.zeros((5 + channels, *grid.size), np.float32)
        self.mass = 0.0
        self._spare = np.empty((channels, *grid.size), np.float32)

    def clear(self, grid: Grid) -> None:
        """Begin anew on a grid of the same size."""
        self.grid, self.mass = grid, 0.0
        self.images[:] = 0

    def add(self, points: Points, place: Place) -> None:
        """Add points, whose weights are typically one, at places (rows, columns)."""
        samples = points.values, points.weights, *place, points.first
        one_frame = len(points.first) == 2  # which has no second half
        others = self.images[:, :0] if one_frame else np.zeros_like(self.images)
        team.hand_out(
            len(points.weights),
            accumulate,
            *samples,
            self.grid.origin,
            self.grid.density,
            self.images,
            others,
        )
        if not one_frame:
            self.images += others
        self.mass += float(points.weights.sum())

    def solve(self, *, smoothing: float, sweeps: int, start: Image | None = None) -> Mosaic:
        """The mosaic of what was added.

        Args:
            smoothing: λ in units of 1/σ, σ the typical deviation of a sample.
            sweeps: over the equations.
            start: a first U on the same grid.
        """
        image = _weighted_mean(self.images) if start is None else start.copy()
        for _ in range(sweeps):
            sweep(self.images, image, self._spare, smoothing, self.grid.density)
            image, self._spare = self._spare, image
        return self.mosaic(image, self.covered())

    def covered(self) -> Mask:
        """The nodes (rows, columns) around which there are samples."""
        around = cv2.blur(self.images[0], (3, 3))
        seen = thinned(around)
        seen = seen[seen > 0]
        return np.asarray(around > (COVERED * quantile(seen, 0.5) if seen.size else 0))

    def mosaic(self, image: Image, covered: Mask) -> Mosaic:
        """An image that was found with what it needs as a mosaic."""
        mass_per_node = self.mass / max(int(np.count_nonzero(covered)), 1)
        # That of central differences of independent nodes: the prior lowers it, picking steep ones raises it.
        noise = len(image) * self.grid.density**2 / (2 * mass_per_node + 1e-30)
        return Mosaic(image, node_kinds(image, covered), self.grid, noise)


def _weighted_mean(sums: Image) -> Image:
    """A first U: the weighted mean of the samples around each node, of farther ones where there are none."""
    right = sums[5:]
    top: Image = right
    bottom: Image = sums[0] + 2 * sums[1:5].sum(axis=0)  # sums over the stencil's rows, but for their places
    enough = 1e-3 * float(bottom.mean())
    result = np.zeros_like(right)
    known = np.zeros(bottom.shape, dtype=bool)
    for _ in range(4):
        top = np.stack([cv2.blur(channel, (5, 5)) for channel in top])
        bottom = np.asarray(cv2.blur(bottom, (5, 5)), np.float32)
        fresh = ~known & (bottom > enough)
        np.divide(top, bottom, out=result, where=fresh)
        known |= fresh
        if known.all():
            return result
    result[:, ~known] = result[:, known].mean(axis=1, keepdims=True) if known.any() else 0
    return result
