"""The paper's data term: every sample falls on the one fused pixel under its centre.

Source: Schuon et al., CVPR 2009, with W_k read as sparse. The sum over frames of w_k (d_k − x)² is
w (x − m)² plus a constant, with w the sum of the weights and m the weighted mean, so N frames cost as one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver import kernels
from solver.errors import FusionInputError


@dataclass(frozen=True, slots=True)
class Samples:
    """Σ w_k (d_k − x)² = Σ weight · (x − mean)² + constant.

    Attributes:
        weight: (βH, βW) float32, how many samples fell on each pixel.
        mean: (βH, βW) float32, their mean, in the distance's unit; 0 where there are none.
        constant: Σ w_k (d_k − mean)², the part that no map can change.
    """

    weight: NDArray[np.float32]
    mean: NDArray[np.float32]
    constant: float


def sample(distance: NDArray[np.float32], positions: NDArray[np.float32], factor: int) -> Samples:
    """Scatter frames (N, H, W) onto the fused grid.

    Raises:
        FusionInputError: no valid sample falls on the grid of frame 0.
    """
    shape = (distance.shape[1] * factor, distance.shape[2] * factor)
    weight = np.zeros(shape, np.float32)
    total = np.zeros(shape, np.float32)
    squares = np.zeros(1)
    kernels.scatter(distance, positions, weight, total, squares, factor)
    seen = weight > 0
    if not seen.any():
        raise FusionInputError(
            "no valid pixel falls on the grid of frame 0; expected shifts smaller than the image"
        )
    mean = np.divide(total, weight, out=total, where=seen)
    constant = float(squares[0] - np.vdot(weight.astype(np.float64), mean.astype(np.float64) ** 2))
    return Samples(weight, mean, max(0.0, constant))
