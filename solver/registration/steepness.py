"""Where a mosaic is steep: only there does a displacement change what a frame sees."""

import cv2
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


def node_kinds(image: Image, covered: Mask) -> Kind:
    """Nodes seen, and those within two nodes of the steepest part of the mosaic.

    Slopes at the rim of what is covered are not the scene's, and do not count.
    """
    square = np.zeros(covered.shape, np.float32)
    _steepness(image, square)
    kind = covered.view(np.uint8)  # UNSEEN and FLAT are 0 and 1
    inner = cv2.erode(kind, np.ones((3, 3), np.uint8), borderValue=0).view(np.bool_)
    some = square[::3, ::3][inner[::3, ::3]]  # a ninth of the nodes tells the quantile
    if not some.size:
        return kind
    limit = quantile(some, 1 - STEEPEST)
    near = cv2.dilate((inner & (square >= limit)).view(np.uint8), np.ones((5, 5), np.uint8))
    return np.asarray(kind + (kind & near))


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
