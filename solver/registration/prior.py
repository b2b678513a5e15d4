"""The mosaic's prior λ Σ √(|∇U|² + ε²), reweighted at an image: a quadratic one of varying stiffness."""

import numba
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

EPSILON = 0.3  # of a deviation between nodes: where the prior turns from quadratic to absolute


def stiffness(image: Image, strength: float, epsilon: float) -> Image:
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
def stiffen(data, stiffness, stencil):  # type: ignore[no-untyped-def]
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
