"""Linear systems of symmetric five-point operators, see `solver.kernels.five_point`."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels.five_point import advance, factorise, multiply, precondition

Image = NDArray[np.float32]

_CREEPING = 100
"""Steps preconditioned by the diagonal alone, which cost less; most systems need no more."""


def conjugate_gradients(
    stencil: Image,
    right: Image,
    start: Image,
    *,
    steps: int,
    tolerance: float = 0.0,
) -> tuple[Image, int]:
    """Solve stencil · image = right, preconditioned by its diagonal, then by incomplete Cholesky factors.

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
    multiply(stencil, image, product)
    residual, direction = right - product, np.zeros_like(start)
    enough, before = tolerance**2 * float((right.astype(np.float64) ** 2 / stencil[0]).sum()), np.inf
    # Not a step yet: how large the residual is.
    square = advance(stencil[0], image, residual, direction, product, np.float32(0))
    for step in range(steps):
        if not square > enough:
            return image, step
        if step == _CREEPING:
            factorise(stencil, pivots)
            before = np.inf
        if step < _CREEPING:
            energy = square
            np.divide(residual, stencil[0], out=found)
        else:
            energy = precondition(stencil, pivots, residual, found)
        direction *= np.float32(energy / before)
        direction += found
        length = np.float32(energy / multiply(stencil, direction, product))
        square = advance(stencil[0], image, residual, direction, product, length)
        before = energy
    return image, steps
