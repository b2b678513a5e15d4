"""Where a mosaic is steep: only there does a displacement change what a frame sees."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels.edges import classify, look_up, steepness
from solver.registration.grid import Grid, Place
from solver.registration.point_samples import Points

Image = NDArray[np.float32]
Kind = NDArray[np.uint8]
Mask = NDArray[np.bool_]

STEEPEST = 0.16  # share of the mosaic that counts as steep: its edges
PLENTY = 5000  # values for a quantile


def node_kinds(image: Image, covered: Mask) -> Kind:
    """Nodes seen, and those within two nodes of the steepest part of the mosaic.

    Slopes at the rim of what is covered are not the scene's, and do not count.
    """
    square = np.full(covered.shape, np.float32(-1))
    steepness(image, covered, square)
    some = thinned(square)
    some = some[some >= 0]
    kind = np.empty(covered.shape, np.uint8)
    classify(square, quantile(some, 1 - STEEPEST) if some.size else np.inf, covered, kind)
    return kind


def thinned(image: Image) -> Image:
    """Some thousand values of an image, evenly spread: plenty for a quantile."""
    step = max(1, int(np.sqrt(image.size / PLENTY)))
    return image[::step, ::step]


def quantile(values: Image, share: float) -> float:
    """The nearest value instead of NumPy's interpolated one, which takes longer."""
    k = round(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def steep_blocks(kind: Kind, grid: Grid, points: Points, place: Place) -> Mask:
    """Pixels (N, H, W) of the points' images where the mosaic is steep, or that are not among the points.

    Elsewhere a displacement changes little.
    """
    blocks = np.ones((len(points.first) - 1, points.shape[0] * points.shape[1]), dtype=np.bool_)
    look_up(kind, points.first, points.pixel, *place, *grid.origin, grid.density, blocks)
    return blocks.reshape(-1, *points.shape)


def finer_blocks(blocks: Mask, shape: tuple[int, int]) -> Mask:
    """Blocks of 2 × 2 pixels as an image of their pixels (N, H, W); an odd last pixel has its neighbour's."""
    rows, columns = (
        np.minimum(np.arange(n) // 2, m - 1) for n, m in zip(shape, blocks.shape[1:], strict=True)
    )
    return blocks[:, rows[:, None], columns]
