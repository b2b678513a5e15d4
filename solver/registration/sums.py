"""The normal equations of a mosaic, which samples may be added to, and their solution."""

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.grid import Borders, Grid, Place
from solver.registration.mosaic import Mosaic
from solver.registration.points import Points
from solver.registration.prior import EPSILON, stiffen, stiffness
from solver.registration.steepness import node_kinds, quantile
from solver.stencil import conjugate_gradients

Image = NDArray[np.float32]

COLD = 2  # reweightings from a blurred start; one is enough from an earlier mosaic
WITHIN = 0xFFFFFF  # tells the compiler that an index is not negative: it need not look for wrapping


class Sums:
    """The normal equations of samples on a grid, which samples may be added to; kept, they are memory ready.

    Args:
        grid: where the nodes are.
        channels: C of the samples' values.
    """

    def __init__(self, grid: Grid, channels: int) -> None:
        self.grid = grid
        # The prior changes the first three of the stencil's five images; these are the data's own.
        self._data = np.zeros((3, *grid.size), np.float32)
        self._stencil = np.zeros((5, *grid.size), np.float32)
        self._right = np.zeros((channels, *grid.size), np.float32)
        self._scratch = np.empty((3, channels, *grid.size), np.float32)
        self._mass = 0.0
        self._held: tuple[list[Image], float] | None = None

    def clear(self, grid: Grid) -> None:
        """Begin anew on a grid of the same size."""
        self.grid, self._mass = grid, 0.0
        for sums in self._of_data():
            sums[:] = 0

    def fade(self, keep: float) -> None:
        """Let what was added count less, and in its place what is held."""
        for sums in self._of_data():
            sums *= np.float32(keep)
        self._mass *= keep
        if self._held is not None:
            held, mass = self._held
            for sums, part in zip(self._of_data(), held, strict=True):
                _add_part(sums, part, np.float32(1 - keep))
            self._mass += (1 - keep) * mass

    def hold(self, share: float) -> None:
        """From now on fade towards a share of what has been added so far instead of nothing."""
        self._held = [np.float32(share) * sums for sums in self._of_data()], share * self._mass

    def _of_data(self) -> tuple[Image, Image, Image]:
        return self._data, self._stencil[3:], self._right

    def extend(self, borders: Borders) -> None:
        """Go on with a larger grid."""
        self.grid = self.grid.extended(borders)
        wide = ((0, 0), *borders)
        self._data, self._stencil, self._right = (
            np.pad(sums, wide) for sums in (self._data, self._stencil, self._right)
        )
        self._scratch = np.empty((3, *self._right.shape), np.float32)
        if self._held is not None:
            held, mass = self._held
            self._held = [np.pad(part, wide) for part in held], mass

    def add(self, points: Points, place: Place) -> None:
        """Add points, whose weights are typically one, at places (rows, columns)."""
        grid = *self.grid.origin, self.grid.density
        _accumulate(points.values, points.weights, *place, *grid, self._data, self._stencil, self._right)
        self._mass += float(points.weights.sum())

    def solve(self, *, smoothing: float, sweeps: int, start: Image | None = None) -> Mosaic:
        """The mosaic of what was added.

        Args:
            smoothing: λ in units of 1/σ, σ the typical deviation of a sample.
            sweeps: conjugate-gradient steps per reweighting.
            start: a first U on the same grid.
        """
        mass = cv2.blur(self._data[0], (3, 3))
        image = _weighted_mean(self._data, self._right) if start is None else start
        density = self.grid.density
        for _ in range(COLD if start is None else 1):
            stiffen(self._data, stiffness(image, smoothing, EPSILON / density), self._stencil)
            image, _ = conjugate_gradients(
                self._stencil, self._right, image, steps=sweeps, scratch=self._scratch
            )
        seen = mass[::3, ::3]
        covered = mass > (0.1 * quantile(seen[seen > 0], 0.5) if seen.any() else 0)
        mass_per_node = self._mass / max(int(np.count_nonzero(covered)), 1)
        # That of central differences of independent nodes: the prior lowers it, picking steep ones raises it.
        noise = len(image) * density**2 / (2 * mass_per_node + 1e-30)
        return Mosaic(image, node_kinds(image, covered), self.grid, noise)


def _weighted_mean(data: Image, right: Image) -> Image:
    """A first U: the weighted mean of the samples around each node, of farther ones where there are none."""
    top: Image = right
    bottom: Image = data.sum(axis=0)
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


@numba.njit(cache=True, fastmath=True)
def _add_part(sums, part, factor):  # type: ignore[no-untyped-def]
    for h in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            into, more = sums[h, i], part[h, i]
            for j in range(len(into)):
                into[j] += factor * more[j]


@numba.njit(cache=True, fastmath=True)
def _accumulate(values, weights, row, column, row0, column0, density, D, S, b):  # type: ignore[no-untyped-def]
    """Add the samples: D is the diagonal and the couplings right and below, S the whole, b the right side."""
    channels, rows, columns = b.shape
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
        D[0, m, n] += w * w00 * w00
        D[0, m, n + 1] += w * w01 * w01
        D[0, m + 1, n] += w * w10 * w10
        D[0, m + 1, n + 1] += w * w11 * w11
        D[1, m, n] += w * w00 * w01  # to the right
        D[1, m + 1, n] += w * w10 * w11
        D[2, m, n] += w * w00 * w10  # down
        D[2, m, n + 1] += w * w01 * w11
        S[3, m, n] += w * w00 * w11  # down and right
        S[4, m, n + 1] += w * w01 * w10  # down and left
