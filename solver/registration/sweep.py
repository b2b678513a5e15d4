"""Sweeps over a mosaic's normal equations: the prior is reweighted and every row solved for on the way.

The normal operator is a nine-point stencil: five images of the data's sums — the diagonal and the couplings
of each node to its neighbours to the right, below, below right and below left; the other four follow by
symmetry — plus the prior λ Σ √(|∇U|² + ε²) as a quadratic one of the stiffness λ / √(|∇U|² + ε²). A sweep
takes one row after the other with the rows above as they are by then (Gauss–Seidel), and the nodes of a row
at once (Jacobi). That lowers the quadratic objective whatever the data: twice the diagonal of each row's
operator outweighs the operator, as samples and differences each couple two of its nodes by no more than the
mean of what they add to both diagonals. Bands of rows are swept on their own, so their first and last rows
step shorter. A sweep takes a single walk where a step of conjugate gradients takes four, and gets further.
"""

import numpy as np
from numpy.typing import NDArray

from solver.kernels.relaxation import relax_and_fade, relax_rows
from solver.runtime import team

Image = NDArray[np.float32]

EPSILON = 0.3  # of a deviation between nodes: where the prior turns from quadratic to absolute


def sweep(sums: Image, image: Image, into: Image, smoothing: float, density: float) -> None:
    """Write an image that fits better than the given one (C, rows, columns).

    Args:
        sums: (5 + C, rows, columns) stencil and right sides of the data.
        into: what is written.
        smoothing: λ in units of 1/σ.
        density: nodes per pixel.
    """
    team.hand_out(image.size, relax_rows, sums, image, into, *_prior(smoothing, density))


def sweep_and_fade(
    sums: Image, image: Image, into: Image, smoothing: float, density: float, keep: float, rest: Image
) -> None:
    """As `sweep`; then let the sums go on to keep · sums + (1 − keep) · rest."""
    team.run(relax_and_fade, sums, image, into, *_prior(smoothing, density), np.float32(keep), rest)


def _prior(smoothing: float, density: float) -> tuple[np.float32, np.float32]:
    """λ and ε²."""
    return np.float32(smoothing), np.float32((EPSILON / density) ** 2)
