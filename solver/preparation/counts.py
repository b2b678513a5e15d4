"""How bright near surfaces are, from how many samples lie nearer to either side.

Samples lie anywhere about an edge, so their share p of the near surface takes all values equally often, and
the part S of the way to it is a half where p = 1 / (1 + b) (see `solver.preparation.unmixing`). From the n
samples with ε < S < 1 − ε, n₁ in the near half and n₂ in the far one, follows

    b = (n₁ − ε n) / (n₂ − ε n).                                                         (1)

The fewer there are, the more counts what is likely: surfaces of the same paint, of which b = (far / near)².
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import shares as kernels
from solver.runtime import team

Image = NDArray[np.float32]
Samples = tuple[Image, Image, np.float32, Image]
"""Distances (N, H, W), their deviations, the one from which a sample is lost, and positions (N, H, W, 2)."""

_PURE, _NOISE = 0.1, 3.0
"""The least ε, and ε in deviations: noise and relief of either surface are not to count."""

_AROUND, _TAPS = 1.0, 7
"""Low-resolution pixels: deviation of the Gaussian, and taps, with which neighbours' samples count."""

_LIKELY = 0.6
"""How many samples, on a pixel, what is likely counts for."""

_LACKING, _SIDE = 0.2, 5
"""The part of samples lost around from which nothing is behind an edge, and b tells nothing; half as many do
no harm; and the side of the square in which they are counted."""


def ratio(samples: Samples, bounds: tuple[Image, Image]) -> Image:
    """(H, W), log b, between bounds (H, W), near and far."""
    distance = samples[0]
    halves, counts = np.empty_like(distance), np.empty((4, *distance.shape[1:]), np.float32)
    pure = np.float32(_PURE), np.float32(_NOISE)
    team.share_frames(len(distance), kernels.classify, *samples, bounds, pure, halves)
    team.share(kernels.tally, halves, counts)
    near, far = around(counts[2:])
    dim = 1 / (1 + same_paint(bounds))  # never 0, as 1 − … is
    found = np.maximum(near, 0) + _LIKELY * (1 - dim)
    found /= np.maximum(far, 0) + _LIKELY * dim
    return np.asarray(clear(counts[:2]) * np.log(found), np.float32)


def around(sums: Image) -> list[Image]:
    """Sums (n, H, W) of samples by pixel, those of neighbours counted in."""
    return [np.asarray(cv2.GaussianBlur(one, (_TAPS, _TAPS), _AROUND)) for one in sums]


def clear(counts: Image) -> Image:
    """How little (H, W) is lost, 0 to 1; counts (2, H, W) of samples that look at a pixel and are lost."""
    looking, lacking = (np.asarray(cv2.blur(part, (_SIDE, _SIDE)), np.float32) for part in counts)
    return np.clip(2 - np.float32(2 / _LACKING) * lacking / np.maximum(looking, 1), 0, 1)


def same_paint(bounds: tuple[Image, Image]) -> Image:
    """b (H, W) of surfaces of the same paint, 1 where near or far is not known."""
    with np.errstate(all="ignore"):
        square = (bounds[1] / bounds[0]) ** 2
    return np.where(np.isfinite(square), square, np.float32(1))
