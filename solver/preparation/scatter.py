"""How much samples deviate where no light tells it: on dark things ten times as much as elsewhere.

Samples of two frames that look at almost the same place differ by their noise alone; the scene's relief
between them is cancelled the better, the more frames there are. For every sample on a pixel of the grid the
nearest other one is looked up, and of all differences the lower quartile is taken, which edges raise less
than a median. Of a normal variable it is

    q = √2 σ Φ⁻¹(5/8).

A median over pixels takes away what is thinner than its square: thin things, of which every pair differs.
"""

from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import twins as kernels
from solver.runtime import team

Image = NDArray[np.float32]

_QUARTILE = 0.25
_TO_SIGMA = float(1 / (np.sqrt(2) * NormalDist().inv_cdf(0.5 + _QUARTILE / 2)))

_SIDE = 5
"""Pixels of the square of the median."""

LEAST = 8
"""Samples on a pixel that tell: of fewer the nearest pairs lie apart, and a slope is taken for noise."""

_STANDS = 2.0
"""Times the usual noise, from which another one is believed, or down to as many times less: of fifteen frames
it is known to a fifth or so, and where it is taken for more than it is, the map is smoothed more. It is less
where things are lit and most of the view is dark or empty."""


def scatter(distance: Image, positions: Image, noise: float, ambiguity_range: float) -> Image:
    """(H, W), the deviation of the samples (N, H, W) on each pixel of the grid; 0 = the usual `noise`.

    Args:
        positions: (N, H, W, 2).
    """
    found = np.empty(distance.shape[1:], np.float32)
    law = np.float32(ambiguity_range), LEAST, _QUARTILE
    team.share(kernels.compare, distance, positions, *law, found)
    found = np.asarray(cv2.medianBlur(found, _SIDE)) * np.float32(_TO_SIGMA)
    usual = (found >= np.float32(noise / _STANDS)) & (found <= np.float32(_STANDS * noise))
    return np.where(usual, np.float32(0), found)


def assign(scatter: Image, positions: Image, noise: float, sigma: Image) -> None:
    """sigma (n, H, W) ← the deviations of samples at positions (n, H, W, 2)."""
    team.share_frames(len(sigma), kernels.assign, scatter, positions, np.float32(noise), sigma)
