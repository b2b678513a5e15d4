"""The multi-scale group prior: λ Σ over pixels of ‖∇X‖₂, every offset's difference in one group.

Source: Schuon, Theobalt, Davis, Thrun, "LidarBoost", CVPR 2009: ∇X(u, v) stacks
G(l, m) = (X(u, v) − X(u + l, v + m)) / √(l² + m²); differences that leave the image are left out.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

NEIGHBOURHOOD: tuple[tuple[int, int], ...] = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
"""(row, column) offsets: one and two pixels along the axes, one along the diagonals."""


@dataclass(frozen=True)
class Prior:
    """The operator ∇ for a set of offsets, each with a non-negative row offset."""

    offsets: NDArray[np.int64] = field(default_factory=lambda: np.array(NEIGHBOURHOOD))

    @property
    def weights(self) -> NDArray[np.float32]:
        """1 / √(l² + m²) by offset."""
        return (1.0 / np.hypot(self.offsets[:, 0], self.offsets[:, 1])).astype(np.float32)

    @property
    def norm(self) -> float:
        """An upper bound of ‖∇‖: each difference of weight w adds at most 4 w² to ‖∇‖²."""
        return float(2.0 * np.sqrt((self.weights.astype(np.float64) ** 2).sum()))

    @property
    def reach(self) -> int:
        """How many rows below its own a group looks."""
        return int(self.offsets[:, 0].max())
