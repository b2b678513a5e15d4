"""What mixed samples would be if they were means of distances.

A pixel at an edge averages phasors, so the brighter side says more. Let a share p of its footprint be on the
near surface, which is b times as bright as the far one. Then the sample lies by the part

    S = p b / (p b + 1 − p)                                                              (1)

of the way from the far distance to the near one; near and far are the bounds of what the frames say around
(see `solver.preparation.consensus`). Without any amplitude b can be read off the samples: they lie anywhere
about an edge, so p takes all values equally often, and S is a half where p = 1 / (1 + b). From the n samples
with ε < S < 1 − ε, n₁ in the near half and n₂ in the far one, follows

    b = (n₁ − ε n) / (n₂ − ε n).                                                         (2)

The fewer there are, the more counts what is likely: surfaces of the same paint, of which b = (far / near)².
With b the shares follow from (1), and with these the means of distances; where S hardly changes with p, or b
is wrong, they are uncertain.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import shares as kernels
from solver.runtime import team

Image = NDArray[np.float32]

_PURE, _NOISE = 0.1, 3.0
"""The least ε, and ε in deviations: noise and relief of either surface are not to count."""

_AROUND, _TAPS = 1.0, 7
"""Low-resolution pixels: deviation of the Gaussian, and taps, with which neighbours' samples count."""

_LIKELY = 0.6
"""How many samples, on a pixel, what is likely counts for."""

_LACKING, _SIDE = 0.2, 5
"""The part of samples lost around from which nothing is behind an edge, and b tells nothing; half as many do
no harm; and the side of the square in which they are counted."""

_DOUBT = 10.0
"""A sample tells its share where so many deviations span the way from near to far, none where half do."""

_ERROR = 0.08
"""Of the way between near and far, times √N p (1 − p): what b errs by, which more frames do not lower."""


class Unmixing:
    """How bright near surfaces are beside the far ones around.

    Attributes:
        bounds: two of (H, W), near and far.
        ratio: (H, W), log b.
    """

    def __init__(
        self, distance: Image, sigma: Image, positions: Image, bounds: tuple[Image, Image], lost: float
    ) -> None:
        """Learn b from samples (N, H, W) that look at positions (N, H, W, 2), their deviations sigma.

        Args:
            bounds: two of (H, W), the nearest and the farthest distance around; ∓∞ = not known.
            lost: deviation from which a sample says nothing.
        """
        self.bounds, self._frames = bounds, len(distance)
        halves, counts = np.empty_like(distance), np.empty((4, *distance.shape[1:]), np.float32)
        samples = distance, sigma, np.float32(lost), positions
        pure = np.float32(_PURE), np.float32(_NOISE)
        team.share_frames(len(distance), kernels.classify, *samples, bounds, pure, halves)
        team.share(kernels.tally, halves, counts)
        looking, lacking = (cv2.blur(part, (_SIDE, _SIDE)) for part in counts[:2])
        near, far = (cv2.GaussianBlur(part, (_TAPS, _TAPS), _AROUND) for part in counts[2:])
        with np.errstate(all="ignore"):  # bounds that are not known
            square = (bounds[1] / bounds[0]) ** 2
            dim = np.where(np.isfinite(square), 1 / (1 + square), 0.5)  # never 0, as 1 − … is
        ratio = np.maximum(near, 0) + _LIKELY * (1 - dim)
        ratio /= np.maximum(far, 0) + _LIKELY * dim
        clear = np.clip(2 - 2 / _LACKING * lacking / np.maximum(looking, 1), 0, 1)
        self.ratio: Image = (clear * np.log(ratio)).astype(np.float32)

    def means(
        self, distance: Image, sigma: Image, positions: Image, least: np.float32
    ) -> tuple[Image, Image]:
        """Means of distances and their deviations, `least` or more, for samples (n, H, W)."""
        means, deviation = np.empty_like(distance), np.empty_like(distance)
        law = least, np.float32(_DOUBT), np.float32(_ERROR * np.sqrt(self._frames))
        samples = distance, sigma, positions
        team.share_frames(
            len(distance), kernels.unmix, *samples, self.bounds, self.ratio, *law, means, deviation
        )
        return means, deviation
