"""The normal equations of a mosaic, which samples may be added to, and their solution."""

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.grid import PLACES, Grid, Place
from solver.registration.mosaic import Mosaic
from solver.registration.points import Points
from solver.registration.steepness import Mask, node_kinds, quantile, thinned
from solver.registration.sweep import sweep

Image = NDArray[np.float32]

COLD = 4  # sweeps from a blurred start; two are enough from an earlier mosaic
COVERED = 0.1  # of the median weight around a node, from which on it counts as seen
WITHIN = 0xFFFFFF  # tells the compiler that an index is not negative: it need not look for wrapping


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
        _accumulate(points.values, points.weights, *place, *self.grid.origin, self.grid.density, self.images)
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


@numba.njit(cache=True, fastmath=PLACES)
def _accumulate(values, weights, row, column, row0, column0, density, sums):  # type: ignore[no-untyped-def]
    """Add the samples to the stencil and the right sides."""
    rows, columns = sums.shape[1:]
    S, b, channels = sums[:5], sums[5:], len(sums) - 5
    top, left, scale, one = np.float32(row0), np.float32(column0), np.float32(density), np.float32(1.0)
    for s in range(len(weights)):
        r, c = (row[s] - top) * scale, (column[s] - left) * scale
        if not (r >= 0.0 and c >= 0.0 and r < rows - 1 and c < columns - 1):
            continue
        m, n = int(r) & WITHIN, int(c) & WITHIN
        a, d, w = r - np.float32(m), c - np.float32(n), weights[s]
        w00, w01 = (one - a) * (one - d), (one - a) * d
        w10, w11 = a * (one - d), a * d
        for h in range(channels):
            y = w * values[s, h]
            b[h, m, n] += w00 * y
            b[h, m, n + 1] += w01 * y
            b[h, m + 1, n] += w10 * y
            b[h, m + 1, n + 1] += w11 * y
        S[0, m, n] += w * w00 * w00
        S[0, m, n + 1] += w * w01 * w01
        S[0, m + 1, n] += w * w10 * w10
        S[0, m + 1, n + 1] += w * w11 * w11
        S[1, m, n] += w * w00 * w01  # to the right
        S[1, m + 1, n] += w * w10 * w11
        S[2, m, n] += w * w00 * w10  # down
        S[2, m, n + 1] += w * w01 * w11
        S[3, m, n] += w * w00 * w11  # down and right
        S[4, m, n + 1] += w * w01 * w10  # down and left
