"""The descent direction on all grids at once, for problems that the pixel's own takes many iterations to.

A preconditioner by pixel carries a value two pixels far in an iteration, so large flat parts, which hold
together stiffly, creep. Here the gradient is summed into cells of 2 × 2, 4 × 4, … pixels, divided on each
grid by what stands for the operator's diagonal there, and the quotients are interpolated back and added:

    M⁻¹ g = Σ_l P_l D_l⁻¹ P_lᵀ g,  D_l = Σ_cell curvature + 4⁻ˡ Σ_cell stiffness

as a hat of side 2ˡ has slopes of 2⁻ˡ. Source: Bramble, Pasciak, Xu, "Parallel multilevel preconditioners",
Math. Comp. 1990.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating]

_COARSEST = 4
"""Pixels across the shorter side down to which there is a coarser grid."""


class Levels:
    """The grids of an operator: a diagonal, and couplings of neighbours whose stiffness may change."""

    def __init__(self, curvature: Image) -> None:
        """For the diagonal (rows, columns), without the couplings."""
        self._curvatures = _pyramid(np.ascontiguousarray(curvature))
        self._coarse: list[Image] = []

    def stiffen(self, stiffness: Image) -> None:
        """Take the couplings, (rows, columns): Σ stiffness · length² of each pixel's own."""
        grids = zip(self._curvatures, _pyramid(np.ascontiguousarray(stiffness)), strict=True)
        self._coarse = [
            curvature + stiff * stiff.dtype.type(4.0**-level)
            for level, (curvature, stiff) in enumerate(grids)
            if level > 0
        ]

    def precondition(self, image: Image, diagonal: Image) -> Image:
        """M⁻¹ image, (rows, columns); `diagonal` is the operator's, couplings included."""
        found: Image | None = None
        pulls = _pyramid(image)
        for pull, whole in zip(pulls[::-1], [diagonal, *self._coarse][::-1], strict=True):
            own = pull / whole
            if found is not None:
                own += cv2.pyrUp(found, dstsize=own.shape[::-1])
            found = own
        assert found is not None
        return found


def _pyramid(image: Image) -> list[Image]:
    """The image, and its sums around every other pixel of the grid before, down to the coarsest grid."""
    grids = [image]
    while min(grids[-1].shape) > _COARSEST:
        grids.append(np.asarray(4 * cv2.pyrDown(grids[-1]), image.dtype))
    return grids
