"""The map that frames are registered against: all of them, fused on a grid somewhat finer than a pixel.

Each frame is a set of point samples of one continuous image, the scene blurred by the pixel's footprint. That
image is written as U, bilinear on a grid of about two nodes per pixel, and found from all samples by

    min_U  Σ_s w_s (y_s − U(p_s))²  +  λ Σ √(|∇U|² + ε²),        w = 1 / σ²

with the second term reweighted (lagged diffusivity). Every sample touches 2 × 2 nodes, so the normal
operator is a nine-point stencil, kept as five coefficient images. The footprint stays inside U: nothing is
deconvolved, and the aliasing of the single frames cancels. The edge-preserving prior matters: with a
quadratic one the noise that stays in U pulls the frames towards each other's noise.
"""

from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.points import Points
from solver.stencil import conjugate_gradients

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Place = tuple[Image, Image]

Borders = tuple[tuple[int, int], tuple[int, int]]

UNSEEN, FLAT, STEEP = 0, 1, 2
COLD = 2  # reweightings from a blurred start; one is enough from an earlier mosaic
STEEPEST = 0.16  # share of the mosaic that counts as steep: its edges
MARGIN = 2  # pixels around the samples, for slopes at the border
SPARE = 6  # nodes; a grid that grows often costs more than one that is somewhat larger
WITHIN = 0xFFFFFF  # tells the compiler that an index is not negative: it need not look for wrapping
EPSILON = 0.3  # of a deviation between nodes: where the prior turns from quadratic to absolute


@dataclass(frozen=True, slots=True)
class Grid:
    """Nodes: `density` per pixel, the first one at `origin` (row, column) in pixels of the reference.

    A whole number of nodes per pixel would put all pixels of the reference, and of every shifted frame, at
    the same place between nodes, where the interpolation error has the same sign; a fraction lets it average
    out.
    """

    origin: tuple[float, float]
    size: tuple[int, int]
    density: float

    @classmethod
    def over(cls, place: Place, shape: tuple[int, int], density: float) -> "Grid":
        """The grid that holds those places (rows, columns) that are within one image of the reference."""
        first, last = _extent(*place, *shape)
        low, high = np.floor(first) - MARGIN, np.ceil(last) + MARGIN
        rows, columns = np.ceil((high - low) * density).astype(int) + 1
        return cls((float(low[0]), float(low[1])), (int(rows), int(columns)), density)

    def lacking(self, place: Place, shape: tuple[int, int]) -> Borders:
        """Nodes to add before and after in rows and columns to hold other places too, with some to spare."""
        first, last = _extent(*place, *shape)
        borders = []
        for start, size, low, high in zip(self.origin, self.size, first, last, strict=True):
            before = int(np.ceil((start - low + 1) * self.density))
            after = int(np.ceil((high + 1 - start) * self.density)) + 1 - size
            borders.append((before + SPARE if before > 0 else 0, after + SPARE if after > 0 else 0))
        return borders[0], borders[1]

    def extended(self, borders: Borders) -> "Grid":
        """The grid with nodes added before and after in rows and columns."""
        origin = [
            start - before / self.density for start, (before, _) in zip(self.origin, borders, strict=True)
        ]
        rows, columns = (size + sum(border) for size, border in zip(self.size, borders, strict=True))
        return Grid((origin[0], origin[1]), (rows, columns), self.density)

    def staggered(self, back: int) -> "Grid":
        """The grid whose nodes lie in the middle of this one's cells, above and left where `back` is even."""
        half = (0.5 if back % 2 else -0.5) / self.density
        return replace(self, origin=(self.origin[0] + half, self.origin[1] + half))


@dataclass(frozen=True, slots=True)
class Mosaic:
    """U (C, rows, columns), each node's kind, and the variance of its slopes per pixel from noise alone.

    The kinds are `UNSEEN`, `FLAT` and `STEEP`.
    """

    values: Image
    kind: NDArray[np.uint8]
    grid: Grid
    slope_noise: float


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

    def clear(self, grid: Grid) -> None:
        """Begin anew on a grid of the same size."""
        self.grid, self._mass = grid, 0.0
        for sums in (self._data, self._stencil[3:], self._right):
            sums[:] = 0

    def fade(self, keep: float) -> None:
        """Let what was added count less."""
        for sums in (self._data, self._stencil[3:], self._right):
            sums *= np.float32(keep)
        self._mass *= keep

    def extend(self, borders: Borders) -> None:
        """Go on with a larger grid."""
        self.grid = self.grid.extended(borders)
        wide = ((0, 0), *borders)
        self._data, self._stencil, self._right = (
            np.pad(sums, wide) for sums in (self._data, self._stencil, self._right)
        )
        self._scratch = np.empty((3, *self._right.shape), np.float32)

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
            _stiffen(self._data, _stiffness(image, smoothing, EPSILON / density), self._stencil)
            image, _ = conjugate_gradients(
                self._stencil, self._right, image, steps=sweeps, scratch=self._scratch
            )
        seen = mass[::3, ::3]
        covered = mass > (0.1 * _quantile(seen[seen > 0], 0.5) if seen.any() else 0)
        mass_per_node = self._mass / max(int(np.count_nonzero(covered)), 1)
        # That of central differences of independent nodes: the prior lowers it, picking steep ones raises it.
        noise = len(image) * density**2 / (2 * mass_per_node + 1e-30)
        square = np.zeros(self.grid.size, np.float32)
        _steepness(image, square)
        return Mosaic(image, _kinds(square, covered), self.grid, noise)


def _kinds(square: Image, covered: Mask) -> NDArray[np.uint8]:
    """Nodes seen, and those within two nodes of the steepest part of the mosaic.

    Slopes at the rim of what is covered are not the scene's, and do not count.
    """
    kind = covered.astype(np.uint8)  # UNSEEN and FLAT are 0 and 1
    inner = cv2.erode(kind, np.ones((3, 3), np.uint8), borderValue=0) > 0
    some = square[::3, ::3][inner[::3, ::3]]  # a ninth of the nodes tells the quantile
    if some.size:
        limit = _quantile(some, 1 - STEEPEST)
        near = cv2.dilate((inner & (square >= limit)).astype(np.uint8), np.ones((5, 5), np.uint8))
        kind[covered & (near > 0)] = STEEP
    return kind


def _quantile(values: Image, share: float) -> float:
    """The nearest value instead of NumPy's interpolated one, in a third of its time."""
    k = round(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def resampled(mosaic: Mosaic, grid: Grid, factor: float) -> Image:
    """A mosaic's U at the nodes of a grid whose pixels are `factor` of the mosaic's, edges repeated."""
    scale = mosaic.grid.density * factor / grid.density
    offset = [
        ((place + 0.5) * factor - 0.5 - start) * mosaic.grid.density
        for place, start in zip(grid.origin, mosaic.grid.origin, strict=True)
    ]
    matrix = np.array([[scale, 0, offset[1]], [0, scale, offset[0]]])
    size = (grid.size[1], grid.size[0])
    flags = (cv2.INTER_LINEAR if factor != 1 else cv2.INTER_CUBIC) | cv2.WARP_INVERSE_MAP
    values = np.empty((len(mosaic.values), *grid.size), np.float32)
    for image, into in zip(mosaic.values, values, strict=True):
        cv2.warpAffine(image, matrix, size, into, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return values


def steep_blocks(mosaic: Mosaic, points: Points, place: Place) -> Mask:
    """Pixels (N, H, W) of the points' images where the mosaic is steep, or that are not among the points.

    Elsewhere a displacement changes little.
    """
    blocks = np.ones((len(points.first) - 1, points.shape[0] * points.shape[1]), dtype=np.bool_)
    _look_up(
        mosaic.kind, points.first, points.pixel, *place, *mosaic.grid.origin, mosaic.grid.density, blocks
    )
    return blocks.reshape(-1, *points.shape)


def finer_blocks(blocks: Mask, shape: tuple[int, int]) -> Mask:
    """Blocks of 2 × 2 pixels as an image of their pixels (N, H, W); an odd last pixel has its neighbour's."""
    rows, columns = (
        np.minimum(np.arange(n) // 2, m - 1) for n, m in zip(shape, blocks.shape[1:], strict=True)
    )
    return blocks[:, rows[:, None], columns]


@numba.njit(cache=True)
def _look_up(kind, first, pixel, row, column, row0, column0, density, blocks):  # type: ignore[no-untyped-def]
    rows, columns = kind.shape
    top, left, scale, half = np.float32(row0), np.float32(column0), np.float32(density), np.float32(0.5)
    for k in range(len(blocks)):
        for s in range(first[k], first[k + 1]):
            r, c = (row[s] - top) * scale + half, (column[s] - left) * scale + half
            inside = r >= 0.0 and c >= 0.0 and r < rows and c < columns
            blocks[k, pixel[s]] = inside and kind[int(r), int(c)] == STEEP


@numba.njit(cache=True, fastmath=True)
def _extent(row, column, height, width):  # type: ignore[no-untyped-def]
    """First and last row and column of the places that are at most one image away from the reference."""
    rows, columns = np.float32(height), np.float32(width)
    top, left, bottom, right = 2 * rows, 2 * columns, -rows, -columns
    for s in range(len(row)):
        r, c = row[s], column[s]
        if r >= -rows and r <= 2 * rows and c >= -columns and c <= 2 * columns:
            top, left, bottom, right = min(top, r), min(left, c), max(bottom, r), max(right, c)
    return np.array([[top, left], [max(top, bottom), max(left, right)]])


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


def _stiffness(image: Image, strength: float, epsilon: float) -> Image:
    """The prior reweighted at the image, (rows, columns): λ / √(|∇U|² + ε²).

    |∇U|² is the mean over both sides of a node and no wider: with a mean of 3 × 3 nodes edges are held less
    well, and registration errs by a tenth more.
    """
    square = np.zeros(image.shape[1:], np.float32)
    _jumps(image, square)
    square += np.float32(epsilon**2)
    np.sqrt(square, out=square)
    return np.divide(np.float32(strength), square, out=square)


@numba.njit(cache=True, fastmath=True)
def _jumps(image, square):  # type: ignore[no-untyped-def]
    """Add |∇U|² from the differences on both sides of a node: one side alone would shift what is smoothed."""
    channels, rows, columns = image.shape
    half = np.float32(0.5)
    for i in range(rows):
        up, low = max(i - 1, 0), min(i + 1, rows - 1)
        out = square[i, 1:-1]
        for h in range(channels):
            x, above, below = image[h, i, 1:-1], image[h, up, 1:-1], image[h, low, 1:-1]
            before, after = image[h, i, :-2], image[h, i, 2:]
            for j in range(columns - 2):
                left, right, top, bottom = x[j] - before[j], after[j] - x[j], x[j] - above[j], below[j] - x[j]
                out[j] += half * (left * left + right * right + top * top + bottom * bottom)
    square[:, 0], square[:, columns - 1] = square[:, 1], square[:, columns - 2]


@numba.njit(cache=True, fastmath=True)
def _stiffen(data, stiffness, stencil):  # type: ignore[no-untyped-def]
    """The diagonal and the couplings to the right and below of the data, with the prior's, into `stencil`."""
    rows, columns = stiffness.shape
    half = np.float32(0.5)
    for i in range(rows):
        before, after = np.float32(0.5 * (i > 0)), np.float32(0.5 * (i + 1 < rows))
        own, up, low = stiffness[i], stiffness[max(i - 1, 0)], stiffness[min(i + 1, rows - 1)]
        diagonal, south = data[0, i], data[2, i]
        into, into_south = stencil[0, i], stencil[2, i]
        for j in range(columns):
            along = after * (own[j] + low[j])
            into_south[j] = south[j] - along
            into[j] = diagonal[j] + along + before * (own[j] + up[j])
        next_own, next_into = own[1:], into[1:]
        east, into_east = data[1, i], stencil[1, i]
        for j in range(columns - 1):
            across = half * (own[j] + next_own[j])
            into_east[j] = east[j] - across
            into[j] += across
        for j in range(columns - 1):
            next_into[j] += half * (own[j] + next_own[j])


@numba.njit(cache=True, fastmath=True)
def _steepness(image, square):  # type: ignore[no-untyped-def]
    """Add |∇U|² of central differences, four times, inside the border."""
    channels, rows, columns = image.shape
    for i in range(1, rows - 1):
        out = square[i, 1:-1]
        for h in range(channels):
            above, below = image[h, i - 1, 1:-1], image[h, i + 1, 1:-1]
            before, after = image[h, i, :-2], image[h, i, 2:]
            for j in range(columns - 2):
                down, right = below[j] - above[j], after[j] - before[j]
                out[j] += down * down + right * right
