"""The paper's data term: every sample falls on the one fused pixel under its centre.

Source: Schuon et al., CVPR 2009, with W_k read as sparse. The sum over frames of w_k (d_k − x)² is
w (x − m)² plus a constant, with w the sum of the weights and m the weighted mean, so N frames cost as one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.kernels import bound as bounds
from solver.kernels import sparse as kernels
from solver.kernels.group import PAD
from solver.optimisation.certificate import divergence
from solver.optimisation.padding import padded
from solver.optimisation.prior import Prior
from solver.optimisation.term import Operator, State
from solver.runtime import team

_SWEEPS = 8
"""Of the Poisson equation for what the duals leave at unseen pixels, gaps of a few pixels: without them the
bound is loose, more of them hardly raise it."""


@dataclass(frozen=True, slots=True)
class Samples:
    """Σ w_k (d_k − x)² = Σ weight · (x − mean)² + constant.

    Attributes:
        weight: (βH, βW) float32, the sum of the weights of the samples that fell on each pixel.
        mean: (βH, βW) float32, their mean, in the distance's unit; 0 where there are none.
        constant: Σ w_k (d_k − mean)², the part that no map can change.
        low, high: the least and the largest mean.
    """

    weight: NDArray[np.float32]
    mean: NDArray[np.float32]
    constant: float
    low: float
    high: float


def sample(
    values: NDArray[np.float32], weights: NDArray[np.float32], positions: NDArray[np.float32], factor: int
) -> Samples:
    """Scatter frames (N, H, W) onto the fused grid; samples of weight 0 are not used.

    Raises:
        FusionInputError: no valid sample falls on the grid of frame 0.
    """
    shape = (values.shape[1] * factor, values.shape[2] * factor)
    weight, mean = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    squares = np.zeros(shape[0])
    team.share(kernels.scatter, values, weights, positions, float(factor), weight, mean, squares)
    moved, low, high = kernels.average(weight, mean)
    if low > high:
        raise FusionInputError(
            "no valid pixel falls on the grid of frame 0; expected shifts smaller than the image"
        )
    return Samples(weight, mean, max(0.0, float(squares.sum()) - moved), float(low), float(high))


class SparseTerm:
    """Σ w (x − m)² + constant."""

    def __init__(self, weight: NDArray[np.floating], mean: NDArray[np.floating], constant: float) -> None:
        """weight and mean (βH, βW), mean and √constant in units of λ."""
        self._weight, self._mean = _pad(weight), _pad(mean)
        self._twice = 2 * self._weight
        self._constant = constant

    @property
    def curvature(self) -> NDArray[np.floating]:
        return self._twice

    def operator(self) -> Operator:
        return Operator(None, self._mean[None])

    def value(self, x: NDArray[np.floating]) -> float:
        sums = np.zeros(x.shape[1] - 2 * PAD)
        team.share(kernels.misfit, x[0], self._weight, self._mean, sums)
        return float(sums.sum()) + self._constant

    def certify(self, state: State, dual: NDArray[np.floating], prior: Prior) -> tuple[float, float]:
        """See `Term`; the duals are changed."""
        # Where there is no sample the duals' divergence has to be 0; around it, any is allowed.
        phi = bounds.potential(divergence(dual, prior.weights)[0], self._weight, _SWEEPS)
        team.share(bounds.correct, dual[0], phi, prior.weights[:2].astype(dual.dtype), state.radius)
        linear = divergence(dual, prior.weights)[0]
        seen, sums = self._mean[self._weight > 0], np.zeros(len(linear))
        team.share(bounds.least, linear, self._weight, self._mean, float(seen.min()), float(seen.max()), sums)
        return self.value(state.x), float(sums.sum()) + self._constant


def _pad(image: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.asarray(padded(image[None])[0])
