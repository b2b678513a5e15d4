"""How hard a prior may hold a map: only so far as the samples bear it (Morozov's discrepancy principle).

Where a map is too smooth all samples of a footprint pull at it in one direction; noise pulls in any. So the
mean square of the data term's gradient over a few low-resolution pixels, in units of what noise makes of it,
tells where a prior hides what the samples show, and the prior gives way there until they agree (locally
adapted, as in Dong, Hintermüller, Rincon-Camacho, "Automated regularization parameter selection in
multi-scale total variation models", J. Math. Imaging Vis. 40, 2011).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import gradients as kernels
from solver.kernels.group import PAD
from solver.runtime import team

Image = NDArray[np.floating]

_WINDOW = 5
"""Low-resolution pixels to a side over which squares are averaged: of fewer the mean is uncertain, and over
more a rough thing frees what is beside it."""

_AGREES = 0.7
"""Discrepancy, in units of noise that nothing is fitted to, at which map and samples agree; a smooth surface
has 0.5 to 0.9."""

_FREEST = 20.0
"""By how much a prior gives way at most: where samples contradict each other no map agrees with them, and one
that is free swings."""


def discrepancy(z: Image, pull: Image, bend: Image, weight: np.floating, factor: int) -> Image:
    """How far map and samples are apart, (rows / factor, columns / factor), in units of noise alone.

    Args:
        z: (2, rows + 4, columns + 4), the phasors, padded.
        pull: (2, rows + 4, columns + 4), the data term's gradient in Z.
        bend: (rows + 4, columns + 4), padded, its second derivatives over the weight.
        weight: inverse variance of a sample's component.
        factor: fused pixels to a low-resolution one.
    """
    shape = [(n - 2 * PAD) // factor for n in bend.shape]
    sums = np.empty((2, *shape), z.dtype)
    team.share(kernels.compare, z, pull, bend, weight, factor, sums)
    squares, expected = (cv2.blur(part, (_WINDOW, _WINDOW)) for part in sums)
    ratio: Image = squares / (expected + np.float32(1e-12))
    return ratio


def eased(ease: Image, ratio: Image) -> Image:
    """By how much the prior is to give way now, at least 1: `ease` is by how much it has, both by pixel."""
    return np.clip(ease * ratio * np.float32(1 / _AGREES), 1, _FREEST)


def spread(image: Image, out: Image) -> None:
    """out (rows, columns) ← an image (rows / factor, columns / factor), interpolated."""
    cv2.resize(image, out.shape[::-1], dst=out, interpolation=cv2.INTER_LINEAR)
