"""How hard a prior may hold a map: only so far as the samples bear it (Morozov's discrepancy principle).

Where a map is too smooth all samples of a footprint pull at it in one direction; noise pulls in any. So the
mean square of the data term's gradient over a few low-resolution pixels, in units of what noise makes of it,
tells where a prior hides what the samples show; and so does that of a gradient which is averaged over some
pixels before it is squared, more surely where they all lack the same. Where either is too large the prior
gives way until they agree (locally adapted, as in Dong, Hintermüller, Rincon-Camacho, "Automated
regularization parameter selection in multi-scale total variation models", J. Math. Imaging Vis. 40, 2011).
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
to a half; with a wider mean the edges of stairs are taken for relief."""

_WINDOW = 5
"""Low-resolution pixels to a side over which squares are averaged: of fewer the mean is uncertain, and over
more a rough thing frees what is beside it."""

_WIDE, _FINE = 0.55, 0.88
"""The squares at which map and samples agree, of gradients that are averaged and of those that are not, in
units of noise that nothing is fitted to. Bright smooth surfaces have 0.2 to 0.6 and 0.75 to 0.95, dim ones
up to 0.75 and 1. Waves of under four pixels are told by the second ones alone, weak ones by the first."""

_NOISIER, _NOISIER_FINE = 0.3, 0.15
"""The powers of the noise that these go with: where there is much of it, less is fitted to it."""

_APART = 0.67
"""Discrepancy beyond agreement at which the map surely lacks something."""

_FREEST = 20.0
"""By how much a prior gives way at most: where samples contradict each other no map agrees with them, and one
that is free swings."""


def discrepancy(z: Image, pull: Image, term: AreaTerm, weight: np.floating, noise: float) -> Image:
    """How far map and samples are apart, (rows // β, columns // β); at 1 they agree.

    Args:
        z: (2, rows + 4, columns + 4), the phasors, padded.
        pull: (2, rows + 4, columns + 4), the data term's gradient in Z.
        term: the data term.
        weight: inverse variance of a sample's component.
        noise: in units of the usual light, over what it usually is there.
    """
    shape = [n // term.factor for n in term.shape[1:]]
    sums: Image = np.empty((3, *shape), z.dtype)
    team.share(kernels.turn, z, pull, term.curvature, weight, term.factor, sums)
    fine = _ratio(sums[1], sums[2], max(term.covariance))
    turned, expected = (np.asarray(cv2.sepFilter2D(part, -1, _MEAN, _MEAN), np.float32) for part in sums[::2])
    wide = _ratio(np.square(turned), expected, _left(term))
    bounds = _WIDE * noise**_NOISIER, _FINE * noise**_NOISIER_FINE
    larger: Image = np.maximum(wide * np.float32(1 / bounds[0]), fine * np.float32(1 / bounds[1]))
    return larger


def _ratio(squares: Image, expected: Image, left: float) -> Image:
    """Squares in units of their noise, `left` ² of what is expected, over the window."""
    over, under = (cv2.blur(part, (_WINDOW, _WINDOW)) for part in (squares, expected))
    ratio: Image = over / (under * np.float32(left**2) + np.float32(1e-12))
    return ratio


def _left(term: AreaTerm) -> float:
    """Along one axis, the variance of a mean of gradients over that of its pixels had each its own noise."""
    mean = np.repeat(_MEAN, term.factor)
    together, apart = sorted((np.convolve(mean, mean), term.covariance), key=len)
    skip = (len(apart) - len(together)) // 2
    return float(together @ apart[skip : skip + len(together)]) / term.factor


def eased(ease: Image, ratio: Image) -> Image:
    """By how much the prior is to give way now, at least 1: `ease` is by how much it has, both by pixel."""
    return np.clip(ease * ratio, 1, _FREEST)


def hidden(ratio: Image) -> Image:
    """How surely, 0 to 1, the map lacks what the samples show: all of it from `_APART` beyond agreement."""
    sure: Image = np.clip((ratio - 1) * np.float32(1 / _APART), 0, 1)
    return sure


def spread(image: Image, out: Image) -> None:
    """out (rows, columns) ← one of low-resolution pixels, interpolated."""
    cv2.resize(image, out.shape[::-1], dst=out, interpolation=cv2.INTER_LINEAR)
