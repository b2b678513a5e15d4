"""The area a low-resolution pixel sees, and the data term made of it.

    Σ_k ‖Ω_k^½ (y_k − A_k X)‖²

A_k averages X over each pixel's footprint at its exact position: bilinear interpolation of the blurred map
B X, exact for a box of a whole number of fused pixels, a close approximation for other shapes.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.kernels import blur
from solver.kernels import dual as duals
from solver.kernels import interpolation as kernels
from solver.kernels.group import PAD
from solver.optimisation.certificate import divergence, shrinkage
from solver.optimisation.fill import ratio
from solver.optimisation.prior import Prior
from solver.optimisation.term import Operator, State
from solver.options import Footprint
from solver.runtime import team


def footprint_taps(footprint: Footprint, factor: int) -> NDArray[np.float64]:
    """Weights of B along one axis, symmetric, of sum 1.

    Bilinear interpolation widens them by the box of a fused pixel, as the average over a fused pixel
    does; so the taps hold the footprint's mass in steps of one fused pixel.
    """
    half, deviation = 0.5 * footprint.side * factor, footprint.blur * factor
    size = max(1, int(np.ceil(2 * (half + 3 * deviation) - 1e-9)))
    edges: NDArray[np.float64] = np.arange(size + 1) - np.float64(size / 2)
    taps = np.diff(_mass(edges, half, deviation))
    return np.asarray(taps / taps.sum())


def _mass(edges: NDArray[np.float64], half: float, deviation: float) -> NDArray[np.float64]:
    """Mass below each edge of a box [−half, half] blurred by a Gaussian, up to a constant and a factor."""
    if deviation == 0:
        return np.clip(edges, -half, half)
    from scipy.special import ndtr

    def integral(t: NDArray[np.float64]) -> NDArray[np.float64]:
        u = t / deviation
        return np.asarray(deviation * (u * ndtr(u) + np.exp(-u * u / 2) / np.sqrt(2 * np.pi)))

    return integral(edges + half) - integral(edges - half)


class AreaTerm:
    """Σ Ω (y − A X)² over C channels, through its gradient.

    The map reaches `margin` fused pixels beyond the grid of frame 0 on every side, so that pixels that look
    just outside count for what they see inside.
    """

    def __init__(
        self,
        values: NDArray[np.floating],
        weights: NDArray[np.floating],
        positions: NDArray[np.float32],
        factor: int,
        footprint: Footprint,
        margin: int = 0,
    ) -> None:
        """values (C, N, H, W) in units of λ; weights (N, H, W), 0 = not used; positions (N, H, W, 2)."""
        taps = footprint_taps(footprint, factor)
        self.factor = factor
        self._size = len(taps)
        self.margin = max(margin, factor + max(0, -(-(self._size - factor) // 2)))
        kind = values.dtype
        self._taps = np.zeros(-(-self._size // 4) * 4, kind)
        self._taps[: self._size] = taps
        rows, columns = (n * factor + 2 * self.margin for n in values.shape[2:])
        self.shape = (len(values), rows, columns)
        nodes = (rows - self._size + 3, columns - self._size + 3)
        self._stencil, self._side = np.zeros((5, *nodes), kind), np.zeros((len(values), *nodes), kind)
        self._grid = (float(factor), self.margin - self._size / 2, (nodes[0] - 2, nodes[1] - 2))
        self._samples = self._placed(values, weights, positions)
        if self._samples[-1][..., 1].max() < 0:
            raise FusionInputError(
                "no valid pixel falls on the grid of frame 0; expected shifts smaller than the image"
            )
        team.share(kernels.accumulate, *self._samples, self._stencil, self._side)
        self._blurred = np.zeros((len(values), *nodes), kind)
        self.curvature: NDArray[np.floating] = self._row_sums()

    def _row_sums(self) -> NDArray[np.floating]:
        """Half of them: a row's sum bounds its curvature, and half of it needs fewer iterations."""
        inside = np.zeros((1, self.shape[1] + 2 * PAD, self.shape[2] + 2 * PAD), self._side.dtype)
        inside[:, PAD:-PAD, PAD:-PAD] = 1
        sums = np.zeros_like(inside)
        self._transform(inside, np.zeros((1, 0, 0), inside.dtype), sums)
        sums *= 0.5
        np.maximum(sums, 0, out=sums)  # what distrust takes off leaves rounding
        return np.asarray(sums[0])

    def _placed(
        self, values: NDArray[np.floating], weights: NDArray[np.floating], positions: NDArray[np.float32]
    ) -> tuple[NDArray[Any], ...]:
        """Samples as the kernels take them, with their nodes, fractions and spans."""
        places = np.empty(weights.shape, np.int32), np.empty((2, *weights.shape), values.dtype)
        spans = np.empty((*weights.shape[:2], 2), np.int32)
        team.share_frames(len(weights), kernels.place, weights, positions, *self._grid, *places, spans)
        return (values, weights, *places, spans)

    def follow(
        self,
        state: State,
        frames: Iterable[int],
        samples: Callable[[slice], tuple[NDArray[np.floating], NDArray[np.floating]]],
        positions: NDArray[np.float32],
    ) -> None:
        """Exchange frames, and have the fit of a state follow.

        Args:
            samples: gives values (C, n, H, W) and weights (n, H, W) of frames.
            positions: (N, H, W, 2).
        """
        for number in frames:
            slot = slice(number, number + 1)
            change = self.exchange(number, *samples(slot), positions[slot], state.x)
            state.fit = None if state.fit is None else state.fit + change

    def exchange(
        self,
        number: int,
        values: NDArray[np.floating],
        weights: NDArray[np.floating],
        positions: NDArray[np.float32],
        x: NDArray[np.floating],
    ) -> float:
        """Put a frame, values (C, 1, H, W), weights (1, H, W), positions (1, H, W, 2), in the place of one.

        The curvature stays as it was: an iteration needs it about right, `certify` exactly.

        Returns by how much that changes the term at the padded map x.
        """
        slot = slice(number, number + 1)
        every, weight, nodes, fractions, spans = self._samples
        kept = every[:, slot], weight[slot], nodes[slot], fractions[:, slot], spans[slot]
        before = [np.ascontiguousarray(image) for image in kept]
        before[1] = -before[1]
        after = self._placed(values, weights, positions)
        team.share(blur.blur, x, self._taps, self._size, self._blurred)
        sums = np.zeros((weights.shape[1], len(x), 5))
        for samples in (before, after):
            team.share_frames(1, kernels.accumulate, *samples, self._stencil, self._side)
            team.share_frames(1, kernels.residuals, *samples, self._blurred, sums)
        for image, new in zip(kept, after, strict=True):
            image[...] = new
        return float(sums[..., 3].sum())

    def distrust(
        self, x: NDArray[np.floating], swings: NDArray[np.floating] | None, noise: float, slack: float
    ) -> None:
        """Weigh down samples that the padded map x does not explain.

        A residual r beyond a = noise / √weight + slack multiplies the weight by (a / r)²: one step of
        iteratively reweighted least squares (Holland, Welsch, "Robust regression using iteratively
        reweighted least-squares", 1977) whose influence falls with the residual.

        Args:
            swings: (rows + 4, columns + 4), the part of the map that explains nothing; None = no pixel's.
            noise: the usual residual's bound, for a sample of weight 1.
            slack: what the model may err by without noise.
        """
        team.share(blur.blur, x, self._taps, self._size, self._blurred)
        values, weights, nodes, fractions, spans = self._samples
        lost, found, kind = np.zeros_like(weights), np.empty_like(spans), weights.dtype.type
        bounds = kind(noise), kind(slack)
        team.share(kernels.distrust, *self._samples, self._blurred, *bounds, lost, found)
        if swings is not None:
            share = np.zeros((1, *self._blurred.shape[1:]), weights.dtype)
            team.share(blur.blur, swings[None], self._taps, self._size, share)
            lost *= 1 - share.ravel()[np.maximum(nodes, 0)]
        if lost.any():
            team.share(kernels.accumulate, values, lost, nodes, fractions, found, self._stencil, self._side)
            weights += lost
            self.curvature = self._row_sums()

    @property
    def stencil(self) -> tuple[NDArray[np.floating], NDArray[np.floating], int]:
        """(M, the taps of B, how many of them count), see `kernels.blur`."""
        return self._stencil, self._taps, self._size

    @property
    def bend(self) -> NDArray[np.floating]:
        """(rows + 4, columns + 4): about the diagonal of Aᵀ Ω A; a footprint spreads over taps²."""
        return self.curvature * self.curvature.dtype.type(1 / self._size**2)

    @property
    def covariance(self) -> NDArray[np.floating]:
        """(2 taps + 1,): along one axis, what pixels so far apart see alike, of sum 1; AᵀA over its row sums.

        Samples lie anywhere between pixels, so their bilinear shares correlate by 1/6, 2/3, 1/6 in the mean.
        """
        taps = self._taps[: self._size]
        return np.convolve(np.convolve(taps, taps), np.array([1, 4, 1]) / 6)

    def pull(self, x: NDArray[np.floating], factor: np.floating, out: NDArray[np.floating]) -> None:
        """out ← factor · Aᵀ Ω (A x − y) at the padded map x."""
        team.share(blur.transform, x, self._stencil, self._side, self._taps, self._size, factor, out)

    def operator(self) -> Operator:
        return Operator((self._stencil, self._side, self._taps, self._size))

    def gradient(self, x: NDArray[np.floating], out: NDArray[np.floating]) -> None:
        """out ← the gradient at the padded map x."""
        self._transform(x, self._side, out)

    def _transform(
        self, x: NDArray[np.floating], side: NDArray[np.floating], out: NDArray[np.floating]
    ) -> None:
        team.share(blur.transform, x, self._stencil, side, self._taps, self._size, x.dtype.type(2), out)

    def mean(self) -> NDArray[np.floating]:
        """(C, rows, columns): the mean of the samples that see each pixel; beyond them, the nearest's."""
        pull = np.zeros((len(self._side), *self.curvature.shape), self.curvature.dtype)
        self.gradient(np.zeros(pull.shape, pull.dtype), pull)
        inner = slice(PAD, -PAD)
        weight = 2 * self.curvature[inner, inner]
        return ratio(np.negative(pull[:, inner, inner]), weight, 1e-3 * float(weight.max()))

    def value(self, x: NDArray[np.floating]) -> float:
        return float(self._sums(x)[:, 3].sum())

    def certify(self, state: State, dual: NDArray[np.floating], prior: Prior) -> tuple[float, float]:
        pull = np.zeros(state.x.shape, state.x.dtype)
        self.gradient(state.x, pull)
        return self.bound(state, dual, prior, pull, np.zeros(2))

    def bound(
        self,
        state: State,
        dual: NDArray[np.floating],
        prior: Prior,
        pull: NDArray[np.floating],
        more: NDArray[np.float64],
    ) -> tuple[float, float]:
        """`certify` for this term and more squares Σ ω (z − G x)², G of differences.

        Args:
            pull: the gradient of all of them at the map.
            more: (2,) Σ ω (z − G x)² and Σ ω (z² − (G x)²).
        """
        total, data, fit, square, rest = self._sums(state.x).T
        # Moving the map by a constant makes the residuals' sum 0, as it is at the optimum.
        offset = (data - fit) / total
        excess = divergence(dual, prior.weights)
        for channel, own, move in zip(excess, pull, offset, strict=True):
            sums, factor = np.zeros(len(channel)), channel.dtype.type(2 * move)
            team.share(duals.add_scaled, channel, own, self.curvature, factor, sums)
            channel -= channel.dtype.type(sums.sum() / channel.size)
        most, lift = shrinkage(dual, state.radius, prior.weights, excess, state.slope)
        # r = 2 Ω (y − A X) has Σ r y = Σ Ω (y − A X)² + Σ Ω (y² − (A X)²), Σ r² / (4 Ω) = Σ Ω (y − A X)².
        moved = float((square - offset**2 * total).sum() + more[0])
        linear = moved + float((rest - 2 * offset * fit - offset**2 * total).sum() + more[1]) + lift
        best = min(most, linear / (2 * moved)) if moved > 0 else most
        return float(square.sum() + more[0]), best * linear - best**2 * moved

    def _sums(self, x: NDArray[np.floating]) -> NDArray[np.float64]:
        """(C, 5), see `kernels.residuals`."""
        team.share(blur.blur, x, self._taps, self._size, self._blurred)
        sums = np.zeros((self._samples[-1].shape[0] * self._samples[-1].shape[1], len(x), 5))
        team.share(kernels.residuals, *self._samples, self._blurred, sums)
        return np.asarray(sums.sum(axis=0))
