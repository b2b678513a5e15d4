"""One surface per fused pixel.

A fused pixel on an edge holds a mixture of the two surfaces' phasors, whose angle is biased to the brighter
one. A surface has one distance, so the pixel is given to the side that fills more than half of it: with P and
M the map 1.5 pixels to either side across the edge, a mixture Z = α P + (1 − α) M goes to P where α > ½.
"""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import mixing as kernels
from solver.kernels import team
from solver.kernels.smoothing import gaussian

_STEP = 1.5
"""Fused pixels from the edge at which one surface is seen alone; 2 and more miss thin parts (measured)."""

_CONTRAST = 0.15
"""|P − M| from which there is an edge, in median amplitudes: as for the reweighting."""

_FAINT = 0.3
"""A pixel whose gradient is below this part of an edge's over two steps lies on none."""

_OFF_LINE = 0.25
"""Z further from the line between P and M, in lengths of it, is no mixture of the two."""

_TAPS = gaussian(1.0, 3).astype(np.float32)
"""A Gaussian of one pixel, which averages the structure tensor."""


def unmix(z: NDArray[np.float32]) -> NDArray[np.float32]:
    """The map with mixed pixels given to one side.

    Args:
        z: (2, rows, columns) real and imaginary part, in median amplitudes.
    """
    # The trace of the structure tensor is the mean square of eight times the gradient.
    least = (8 * _FAINT * _CONTRAST / (2 * _STEP)) ** 2
    out = np.empty_like(z)
    team.share(kernels.assign, z, _TAPS, least, _STEP, _CONTRAST, _OFF_LINE, out)
    return out
