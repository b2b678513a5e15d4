"""Linear systems of symmetric five-point operators, see `solver.kernels.five_point`."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels.five_point import factorise, multiply, precondition

Image = NDArray[np.float32]


def conjugate_gradients(
    stencil: Image,
    right: Image,
    start: Image,
    *,
    steps: int,
    tolerance: float = 0.0,
) -> tuple[Image, int]:
    """Solve stencil · image = right, preconditioned by incomplete Cholesky factors.

    Source: Meijerink, van der Vorst, "An iterative solution method for linear systems of which the
    coefficient matrix is a symmetric M-matrix", Math. Comp. 1977.

    Args:
        stencil: (3, rows, columns), diagonally dominant.
        right, start: (rows, columns).
        steps: the most steps taken.
        tolerance: stop where the residual has fallen to this part of `right`, in the norm of the inverse
            diagonal.

    Returns:
        the image and the number of steps taken.
    """
    image, product, pivots, found = start.copy(), *np.empty((3, *start.shape), np.float32)
    factorise(stencil, pivots)
    multiply(stencil, image, product)
    residual, direction = right - product, np.zeros_like(start)
    enough, before = tolerance**2 * _square(right, stencil[0]), np.inf
    for step in range(steps):
        if not _square(residual, stencil[0]) > enough:
            return image, step
        energy = precondition(stencil, pivots, residual, found)
        direction *= np.float32(energy / before)
        direction += found
        length = np.float32(energy / multiply(stencil, direction, product))
        image += length * direction
        residual -= length * product
        before = energy
    return image, steps


def _square(residual: Image, diagonal: Image) -> float:
    """‖residual‖² in the norm of the inverse diagonal."""
    return float(np.einsum("ij,ij->", residual / diagonal, residual, dtype=np.float64))
