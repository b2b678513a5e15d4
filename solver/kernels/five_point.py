"""Symmetric five-point operators: their product with an image, and a preconditioner.

An operator is three coefficient images (3, rows, columns): the diagonal, and the couplings of each node to
its neighbours to the right and below, 0 in the last column and row. On one thread: a node of the
preconditioner waits for the one before it.
"""

import numpy as np
from numba import njit

_MODIFIED, _LEAST = 0.97, 0.25
"""The part of what the factors leave out that the diagonal takes over, and the part of the diagonal that a
pivot keeps; both from Bridson, "Fluid Simulation for Computer Graphics", 2008."""


@njit(cache=True, fastmath=True)
def multiply(stencil, image, product):  # type: ignore[no-untyped-def]
    """product (rows, columns) ← stencil · image, for stencil (3, rows, columns); returns ⟨image, product⟩."""
    rows, columns = image.shape
    total, none = 0.0, np.zeros(columns, image.dtype)
    for i in range(rows):
        centre, right, below = stencil[0, i], stencil[1, i], stencil[2, i]
        x, down, out = image[i], image[min(i + 1, rows - 1)], product[i]
        up, above = (image[i - 1], stencil[2, i - 1]) if i > 0 else (none, none)
        for j in range(columns):
            out[j] = centre[j] * x[j] + below[j] * down[j] + above[j] * up[j]
        for j in range(columns - 1):
            out[j] += right[j] * x[j + 1]
            out[j + 1] += right[j] * x[j]
        dot = x.dtype.type(0)
        for j in range(columns):
            dot += out[j] * x[j]
        total += dot
    return total


@njit(cache=True, error_model="numpy")
def factorise(stencil, pivots):  # type: ignore[no-untyped-def]
    """Incomplete Cholesky factors without fill, modified so that row sums stay nearly.

    Source: Gustafsson, "A class of first order factorization methods", BIT 1978.

    Args:
        stencil: (3, rows, columns).
        pivots: (rows, columns) ← the inverse squares of the factors' diagonal.
    """
    rows, columns = pivots.shape
    for i in range(rows):
        for j in range(columns):
            whole = left = stencil[0, i, j]
            if j > 0:
                pivot, right = pivots[i, j - 1], stencil[1, i, j - 1]
                left -= right * (right + _MODIFIED * stencil[2, i, j - 1]) * pivot
            if i > 0:
                pivot, below = pivots[i - 1, j], stencil[2, i - 1, j]
                left -= below * (below + _MODIFIED * stencil[1, i - 1, j]) * pivot
            pivots[i, j] = 1 / (left if left > _LEAST * whole else whole)


@njit(cache=True, fastmath={"contract"}, error_model="numpy")
def precondition(stencil, pivots, image, out):  # type: ignore[no-untyped-def]
    """out ← (L Lᵀ)⁻¹ image, L the factors; returns ⟨image, out⟩.

    Args:
        stencil: (3, rows, columns).
        pivots: (rows, columns), of `factorise`.
        image: (rows, columns).
        out: (rows, columns).
    """
    rows, columns = pivots.shape
    line, next_to = np.empty(columns, image.dtype), np.zeros(columns, image.dtype)
    # What does not wait for the pixel before is done first, for a whole row.
    for i in range(rows):
        pivot, own, right = pivots[i], image[i], stencil[1, i]
        above, up = stencil[2, i - 1], out[i - 1]
        for j in range(columns):
            line[j] = pivot[j] * own[j] if i == 0 else pivot[j] * (own[j] - above[j] * up[j])
        for j in range(columns - 1):
            next_to[j + 1] = pivot[j + 1] * right[j]
        before = image.dtype.type(0)
        for j in range(columns):
            before = line[j] - next_to[j] * before
            out[i, j] = before
    total = 0.0
    for i in range(rows - 1, -1, -1):
        pivot, here, right, below = pivots[i], out[i], stencil[1, i], stencil[2, i]
        down = out[min(i + 1, rows - 1)]
        for j in range(columns):
            line[j] = here[j] if i + 1 == rows else here[j] - pivot[j] * below[j] * down[j]
            next_to[j] = pivot[j] * right[j]
        before = image.dtype.type(0)
        for j in range(columns - 1, -1, -1):
            before = line[j] - next_to[j] * before
            here[j] = before
        dot = image.dtype.type(0)
        for j in range(columns):
            dot += here[j] * image[i, j]
        total += dot
        next_to[0] = 0
    return total


@njit(cache=True, fastmath=True, error_model="numpy")
def advance(diagonal, image, residual, direction, product, length):  # type: ignore[no-untyped-def]
    """Move by `length` along a direction; returns ‖residual‖² in the norm of the inverse diagonal.

    Args:
        diagonal: (rows, columns), of the stencil.
        image: (rows, columns), in place.
        residual: (rows, columns), in place.
        direction: (rows, columns).
        product: (rows, columns), stencil · direction.
        length: a number of the image's type.
    """
    rows, columns = image.shape
    total = 0.0
    for i in range(rows):
        dot = image.dtype.type(0)
        for j in range(columns):
            image[i, j] += length * direction[i, j]
            left = residual[i, j] - length * product[i, j]
            residual[i, j] = left
            dot += left * left / diagonal[i, j]
        total += dot
    return total
