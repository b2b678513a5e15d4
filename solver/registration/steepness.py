"""Where a mosaic is steep: only there does a displacement change what a frame sees."""

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.grid import Grid, Place
from solver.registration.points import Points

Image = NDArray[np.float32]
Kind = NDArray[np.uint8]
Mask = NDArray[np.bool_]

UNSEEN, FLAT, STEEP = 0, 1, 2
STEEPEST = 0.16  # share of the mosaic that counts as steep: its edges
PLENTY = 5000  # values for a quantile


def node_kinds(image: Image, covered: Mask) -> Kind:
    """Nodes seen, and those within two nodes of the steepest part of the mosaic.

    Slopes at the rim of what is covered are not the scene's, and do not count.
    """
    square = np.full(covered.shape, np.float32(-1))
    _steepness(image, covered, square)
    some = thinned(square)
    some = some[some >= 0]
    kind = np.empty(covered.shape, np.uint8)
    _classify(square, quantile(some, 1 - STEEPEST) if some.size else np.inf, covered, kind)
    return kind


def thinned(image: Image) -> Image:
    """Some thousand values of an image, evenly spread: plenty for a quantile."""
    step = max(1, int(np.sqrt(image.size / PLENTY)))
    return image[::step, ::step]


def quantile(values: Image, share: float) -> float:
    """The nearest value instead of NumPy's interpolated one, in a third of its time."""
    k = round(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def steep_blocks(kind: Kind, grid: Grid, points: Points, place: Place) -> Mask:
    """Pixels (N, H, W) of the points' images where the mosaic is steep, or that are not among the points.

    Elsewhere a displacement changes little.
    """
    blocks = np.ones((len(points.first) - 1, points.shape[0] * points.shape[1]), dtype=np.bool_)
    _look_up(kind, points.first, points.pixel, *place, *grid.origin, grid.density, blocks)
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
def _steepness(image, covered, square):  # type: ignore[no-untyped-def]
    """|∇U|² of central differences, four times, where all nodes around are covered."""
    channels, rows, columns = image.shape
    line, outside = np.empty(columns, np.bool_), np.float32(-1.0)
    for i in range(1, rows - 1):
        out = square[i, 1:-1]
        out[:] = 0
        for h in range(channels):
            above, below = image[h, i - 1, 1:-1], image[h, i + 1, 1:-1]
            before, after = image[h, i, :-2], image[h, i, 2:]
            for j in range(columns - 2):
                down, right = below[j] - above[j], after[j] - before[j]
                out[j] += down * down + right * right
        up, own, low = covered[i - 1], covered[i], covered[i + 1]
        for j in range(columns):
            line[j] = up[j] & own[j] & low[j]
        west, centre, east = line[:-2], line[1:-1], line[2:]
        for j in range(columns - 2):
            out[j] = out[j] if west[j] & centre[j] & east[j] else outside


@numba.njit(cache=True)
def _classify(square, limit, covered, kind):  # type: ignore[no-untyped-def]
    """STEEP where a node at most two rows and columns away reaches the limit."""
    rows, columns = square.shape
    least = np.float32(limit)
    across = np.zeros((rows, columns), np.uint8)
    line = np.zeros(columns + 4, np.uint8)
    for i in range(rows):
        own, into, out = square[i], line[2:-2], across[i]
        for j in range(columns):
            into[j] = own[j] >= least
        a, b, c, d, e = line[:-4], line[1:-3], line[2:-2], line[3:-1], line[4:]
        for j in range(columns):
            out[j] = a[j] | b[j] | c[j] | d[j] | e[j]
    for i in range(rows):
        seen, out = covered[i], kind[i]
        out[:] = 0
        for near in range(max(i - 2, 0), min(i + 3, rows)):
            steep = across[near]
            for j in range(columns):
                out[j] |= steep[j]
        for j in range(columns):
            out[j] = (out[j] + np.uint8(1)) * np.uint8(seen[j])  # UNSEEN, FLAT and STEEP are 0, 1 and 2
