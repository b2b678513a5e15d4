"""How hard a prior may hold a map: only so far as the samples bear it (Morozov's discrepancy principle).

Where a map is too smooth all samples of a footprint, and of those beside it, pull at it in one direction;
noise pulls in any. So the data term's gradient is averaged over some low-resolution pixels before it is
squared, and the mean of these squares over a few more, in units of what noise makes of it, tells where a
prior hides what the samples show. There the prior gives way until they agree (locally adapted, as in Dong,
Hintermüller, Rincon-Camacho, "Automated regularization parameter selection in multi-scale total variation
models", J. Math. Imaging Vis. 40, 2011).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import gradients as kernels
from solver.optimisation.footprint import AreaTerm
from solver.runtime import team

Image = NDArray[np.floating]

_MEAN = np.array([1, 4, 6, 4, 1], np.float32) / 16
"""Of gradients, over low-resolution pixels along one axis. Noise falls to a quarter by it, waves of six
pixels to a half; with a wider mean the edges of stairs are taken for relief."""

_WINDOW = 5
"""Low-resolution pixels to a side over which squares are averaged: of fewer the mean is uncertain, and over
more a rough thing frees what is beside it."""

_AGREES = 0.6
"""Discrepancy, in units of noise that nothing is fitted to, at which map and samples agree; a smooth surface
has 0.3 to 0.8."""

_APART = 0.4
"""Discrepancy beyond agreement at which the map surely lacks something."""

_FREEST = 20.0
"""By how much a prior gives way at most: where samples contradict each other no map agrees with them, and one
that is free swings."""


def discrepancy(z: Image, pull: Image, term: AreaTerm, weight: np.floating) -> Image:
    """How far map and samples are apart, (rows / β, columns / β), in units of noise alone.

    Args:
        z: (2, rows + 4, columns + 4), the phasors, padded.
        pull: (2, rows + 4, columns + 4), the data term's gradient in Z.
        term: the data term.
        weight: inverse variance of a sample's component.
    """
    shape = [n // term.factor for n in term.shape[1:]]
    sums = np.empty((2, *shape), z.dtype)
    team.share(kernels.turn, z, pull, term.curvature, weight, term.factor, sums)
    turned, expected = (cv2.sepFilter2D(part, -1, _MEAN, _MEAN) for part in sums)
    squares, noise = (cv2.blur(part, (_WINDOW, _WINDOW)) for part in (turned * turned, expected))
    ratio: Image = squares / (noise * np.float32(_left(term) ** 2) + np.float32(1e-12))
    return ratio


def _left(term: AreaTerm) -> float:
    """Along one axis, the variance of a mean of gradients over that of its pixels had each its own noise."""
    mean = np.repeat(_MEAN, term.factor)
    together, apart = sorted((np.convolve(mean, mean), term.covariance), key=len)
    skip = (len(apart) - len(together)) // 2
    return float(together @ apart[skip : skip + len(together)]) / term.factor


def eased(ease: Image, ratio: Image) -> Image:
    """By how much the prior is to give way now, at least 1: `ease` is by how much it has, both by pixel."""
    return np.clip(ease * ratio * np.float32(1 / _AGREES), 1, _FREEST)


def hidden(ratio: Image) -> Image:
    """How surely, 0 to 1, the map lacks what the samples show: all of it from `_APART` beyond agreement."""
    sure: Image = np.clip((ratio - np.float32(_AGREES)) * np.float32(1 / _APART), 0, 1)
    return sure


def spread(image: Image, out: Image) -> None:
    """out (rows, columns) ← an image (rows / factor, columns / factor), interpolated."""
    cv2.resize(image, out.shape[::-1], dst=out, interpolation=cv2.INTER_LINEAR)
