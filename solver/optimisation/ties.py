"""Ties along edges: what the neighbours of an edge pixel on its own side of the edge still tell about it.

A weight by pixel frees an edge pixel in every direction, so edges come out rough and thin parts too weak. A
tie holds two pixels together, so it can be tight along an edge and loose across it:

    ½ Σ t (G X − s)²,  t = strength · (1 − ρ) / (|l, m|² (1 + (d / δ)²)²)

over the six differences G of every pixel, s the slope, ρ the part of its weight that the prior has kept, and
d the size of that very difference in the map of the pass before, averaged over its surroundings. As a
diffusivity that falls with d it goes back to Perona, Malik, "Scale-space and edge detection using anisotropic
diffusion", PAMI 1990; its exponents are set by trial. Ties are quadratic, so they join the data term.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from solver.kernels import learning
from solver.kernels import tying as kernels
from solver.kernels.group import PAD
from solver.kernels.smoothing import gaussian
from solver.optimisation.footprint import AreaTerm
from solver.optimisation.prior import Prior
from solver.optimisation.term import Operator, State
from solver.runtime import team

Image = NDArray[np.floating]

_REACH = 1.2
"""Deviation of the Gaussian that averages sizes of differences, fused pixels: edges go on, noise does not."""

_TAPS = 3
"""To either side: 2.5 deviations."""


@dataclass(frozen=True, slots=True)
class Ties:
    """Ties and the slope that they foretell.

    Attributes:
        levels: uint8 (6, rows + 4, columns + 4), strengths in steps of `unit`.
        unit: (6,), by difference.
        slope: (C, 2, rows + 4, columns + 4).
    """

    levels: NDArray[np.uint8]
    unit: Image
    slope: Image

    @classmethod
    def along_edges(
        cls, x: Image, slope: Image, prior: Prior, freed: Image, strength: float, across: float
    ) -> Self:
        """The ties that a map suggests.

        Args:
            x: (C, rows + 4, columns + 4), padded.
            slope: as in `solver.optimisation.slope`.
            prior: whose differences are tied.
            freed: (rows + 4, columns + 4), 1 − ρ: the part of its weight that the prior has lost.
            strength: of a tie where it is all lost and nothing is to be seen across the tie.
            across: δ, the difference at which a tie is a quarter as strong.
        """
        kind = x.dtype.type
        weights = prior.weights.astype(x.dtype) ** 2
        levels = np.empty((len(weights), *x.shape[1:]), np.uint8)
        taps = gaussian(_REACH, _TAPS).astype(x.dtype)
        team.share(learning.tie, x, slope, prior.tables(x), taps, freed, kind(1 / across), levels)
        return cls(levels, weights * kind(strength / 255), slope)


class Tied:
    """A data term and ties, together a `Term`.

    Attributes:
        data: the data term; `curvature` is that of both.
    """

    def __init__(self, term: AreaTerm, ties: Ties) -> None:
        self.data, self._ties = term, ties
        self.curvature: Image = term.curvature.copy()
        team.share(kernels.add_diagonal, ties.levels, ties.unit, self.curvature)
        self._lift: Image = np.zeros_like(ties.slope[:, 0])
        team.share(kernels.lift, ties.slope, ties.levels, ties.unit, self._lift)

    def operator(self) -> Operator:
        return replace(self.data.operator(), ties=(self._ties.levels, self._ties.unit, self._lift))

    def gradient(self, x: Image, out: Image) -> None:
        """out ← the gradient at the padded map x."""
        self.data.gradient(x, out)
        team.share(kernels.pull_all, x, self._ties.levels, self._ties.unit, out)
        out += self._lift

    def value(self, x: Image) -> float:
        return self.data.value(x) + float(self.sums(x)[0])

    def sums(self, x: Image) -> NDArray[np.float64]:
        """(2,): ½ Σ t (G x − s)² and ½ Σ t (s² − (G x)²)."""
        rows = np.zeros((x.shape[1] - 2 * PAD, 2))
        team.share(kernels.sums, x, self._ties.slope, self._ties.levels, self._ties.unit, rows)
        return np.asarray(rows.sum(axis=0))

    def certify(self, state: State, dual: Image, prior: Prior) -> tuple[float, float]:
        pull: Image = np.zeros_like(state.x)
        self.gradient(state.x, pull)
        return self.data.bound(state, dual, prior, pull, self.sums(state.x))
