"""One surface per fused pixel.

A fused pixel on an edge holds a mixture of the two surfaces' phasors, whose angle is biased to the brighter
one. A surface has one distance, so the pixel is given to the side that fills more than half of it: with P and
M the map 1.5 pixels to either side across the edge, a mixture Z = α P + (1 − α) M goes to P where α > ½.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import mixing as kernels

_STEP = 1.5
"""Fused pixels from the edge at which one surface is seen alone; 2 and more miss thin parts (measured)."""

_CONTRAST = 0.15
"""|P − M| from which there is an edge, in median amplitudes: as for the reweighting."""

_FAINT = 0.3
"""A pixel whose gradient is below this part of an edge's over two steps lies on none."""

_OFF_LINE = 0.25
"""Z further from the line between P and M, in lengths of it, is no mixture of the two."""


def unmix(z: NDArray[np.float32]) -> NDArray[np.float32]:
    """The map with mixed pixels given to one side.

    Args:
        z: (2, rows, columns) real and imaginary part, in median amplitudes.
    """
    down = [cv2.Sobel(channel, cv2.CV_32F, 0, 1) for channel in z]
    right = [cv2.Sobel(channel, cv2.CV_32F, 1, 0) for channel in z]
    products = (
        sum(d * d for d in down),
        sum(r * r for r in right),
        sum(d * r for d, r in zip(down, right, strict=True)),
    )
    down2, right2, both = (cv2.GaussianBlur(np.asarray(product), (0, 0), 1.0) for product in products)
    # The trace of the structure tensor is the mean square of eight times the gradient.
    least = (8 * _FAINT * _CONTRAST / (2 * _STEP)) ** 2
    out = np.empty_like(z)
    kernels.assign(np.ascontiguousarray(z), down2, right2, both, least, _STEP, _CONTRAST, _OFF_LINE, out)
    return out
