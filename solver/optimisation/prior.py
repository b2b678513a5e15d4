"""The multi-scale group prior: λ Σ over pixels of ‖∇X‖₂, every offset's difference in one group.

Source: Schuon, Theobalt, Davis, Thrun, "LidarBoost", CVPR 2009: ∇X(u, v) stacks
G(l, m) = (X(u, v) − X(u + l, v + m)) / √(l² + m²); differences that leave the image are left out. Several
channels of one map share a group.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.kernels import dual
from solver.kernels import group as kernels
from solver.options import NEIGHBOURHOOD, Offset
from solver.runtime import team


@dataclass(frozen=True)
class Prior:
    """The operator ∇ for some of the offsets of `NEIGHBOURHOOD`."""

    offsets: tuple[Offset, ...] = NEIGHBOURHOOD

    @cached_property
    def weights(self) -> NDArray[np.float32]:
        """(6,): 1 / √(l² + m²) by offset of `NEIGHBOURHOOD`, 0 for those not chosen."""
        return np.array(
            [1 / math.hypot(*offset) if offset in self.offsets else 0.0 for offset in NEIGHBOURHOOD],
            np.float32,
        )

    def value(
        self, x: NDArray[np.floating], radius: NDArray[np.floating], slope: NDArray[np.floating] | None = None
    ) -> float:
        """Σ radius ‖∇x − slope‖₂ of a padded map (C, rows + 4, columns + 4); slope as in `slope`."""
        sums = np.zeros(x.shape[1] - 2 * kernels.PAD)
        tilt = level(x) if slope is None else slope
        team.share(kernels.values, x, tilt, self.squared(x), radius, sums)
        return float(sums.sum())

    def norms(
        self, x: NDArray[np.floating], slope: NDArray[np.floating] | None = None
    ) -> NDArray[np.floating]:
        """(rows + 4, columns + 4): ‖∇x − slope‖₂ by pixel of a padded map."""
        out: NDArray[np.floating] = np.zeros(x.shape[1:], x.dtype)
        team.share(kernels.norms, x, level(x) if slope is None else slope, self.squared(x), out)
        return out

    def duals(
        self,
        x: NDArray[np.floating],
        radius: NDArray[np.floating],
        slope: NDArray[np.floating],
        epsilon: float,
    ) -> NDArray[np.floating]:
        """(C, 6, rows + 4, columns + 4): the gradient of radius ‖∇x − slope‖₂, its corner rounded below ε.

        Its groups lie within balls of that radius, so it is a feasible dual variable.
        """
        norms, floor = self.norms(x, slope), x.dtype.type(epsilon)
        out: NDArray[np.floating] = np.zeros((len(x), len(NEIGHBOURHOOD), *x.shape[1:]), x.dtype)
        team.share(dual.duals, x, slope, norms, radius, floor, self.tables(x), out)
        return out

    def squared(self, x: NDArray[np.floating]) -> NDArray[np.floating]:
        """(6,): the squared weights, of x's type."""
        return self.weights.astype(x.dtype) ** 2

    def tables(self, x: NDArray[np.floating]) -> NDArray[np.floating]:
        """`up` of `solver.kernels.group` for a padded map."""
        kind = (x.dtype, x.shape[2] - 4)
        if kind not in self._tables:
            self._tables[kind] = kernels.tables(self.weights.astype(x.dtype), x.shape[2] - 4)
        return self._tables[kind]

    @cached_property
    def _tables(self) -> dict[tuple[np.dtype[Any], int], NDArray[np.floating]]:
        return {}


def level(x: NDArray[np.floating]) -> NDArray[np.floating]:
    """No slope for the map x (C, rows, columns), as the kernels take it."""
    return np.zeros((len(x), 2, 0, 0), x.dtype)
