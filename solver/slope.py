"""Where a map is heading: the slope that the prior lets pass.

A first-order prior charges a ramp as much as the step that climbs as high, so ramps become stairs.
Subtracting the slope of the surroundings makes ramps free: total generalised variation (Bredies, Kunisch,
Pock, "Total generalized variation", SIAM J. Imaging Sci. 2010) with its vector field fixed within a pass.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import slope as kernels
from solver.kernels import team

_REACH = 5.0
"""Deviation of the Gaussian that averages slopes, fused pixels: over one low-resolution pixel at ×4."""


def slope(x: NDArray[np.floating], edge: float) -> NDArray[np.floating]:
    """The rise per row and per column of a padded map, averaged over its surroundings.

    Args:
        x: (C, rows + 4, columns + 4), padded.
        edge: gradient from which a pixel is an edge, which has no slope; such pixels take their neighbours'.

    Returns:
        (C, 2, rows + 4, columns + 4), zero in the padding.
    """
    channels, rows, columns = len(x), x.shape[1] - 4, x.shape[2] - 4
    votes = np.empty((1 + 2 * channels, rows, columns), x.dtype)
    team.share(kernels.votes, x, x.dtype.type(1 / edge**2), votes)
    total = _average(votes[0])
    total += np.finfo(np.float32).tiny
    out = np.zeros((channels, 2, *x.shape[1:]), x.dtype)
    for number, vote in enumerate(votes[1:]):
        np.divide(_average(vote), total, out=out[number // 2, number % 2, 2:-2, 2:-2])
    return out


def _average(image: NDArray[np.floating]) -> NDArray[np.floating]:
    """Gaussian mean, taken at half the resolution, which so wide a Gaussian does not need."""
    rows, columns = image.shape
    half = cv2.resize(image, (max(1, columns // 2), max(1, rows // 2)), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(cv2.GaussianBlur(half, (0, 0), _REACH / 2), (columns, rows)))
