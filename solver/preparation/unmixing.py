"""What mixed samples would be if they were means of distances.

A pixel at an edge averages phasors, so the brighter side says more. Let a share p of its footprint be on the
near surface, which is b times as bright as the far one. Then the sample lies by the part

    S = p b / (p b + 1 − p)                                                              (1)

of the way from the far distance to the near one. With both distances and b the shares follow from (1), and
with these the means of distances. Where S hardly changes with p, or b is wrong, they are uncertain. How far
and how bright both are is read off the lights (see `solver.preparation.lights`); where these are not known,
off medians and how many samples lie nearer to either side (see `solver.preparation.counts`).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from solver.kernels import shares as kernels
from solver.preparation import counts, lights
from solver.preparation.consensus import Consensus
from solver.runtime import team

Image = NDArray[np.float32]

_DOUBT = 10.0
"""A sample tells its share where so many deviations span the way from near to far, none where half do."""

_ERROR = 0.08
"""Of the way between near and far, times √N p (1 − p): what b errs by, and a third surface, which more frames
do not lower. From 0.05 to 0.14 hardly matter."""


@dataclass(frozen=True, eq=False, slots=True)
class Unmixing:
    """How bright near surfaces are beside the far ones around.

    Attributes:
        bounds: two of (H, W), near and far; infinite where not known.
        ratio: (H, W), log b; 0 where samples stay as they are.
        error: of the way between near and far, times p (1 − p): what a mean errs by.
    """

    bounds: tuple[Image, Image]
    ratio: Image
    error: float

    @classmethod
    def learned(
        cls, consensus: Consensus, sigma: Image, positions: Image, amplitude: Image | None, lost: float
    ) -> Self:
        """From all samples (N, H, W), of deviations sigma, that look at positions (N, H, W, 2).

        Args:
            amplitude: (N, H, W), linear in the received light, or None.
            lost: deviation from which a sample says nothing.
        """
        bounds = consensus.bounds
        samples = consensus.measured, sigma, np.float32(lost), positions
        error = _ERROR * float(np.sqrt(len(sigma)))
        if amplitude is None:
            return cls(bounds, counts.ratio(samples, bounds), error)
        bounds = lights.ends(consensus.kept(), sigma, lost, positions, bounds)
        return cls(bounds, lights.ratio(samples, amplitude, bounds), error)

    def means(
        self, distance: Image, sigma: Image, positions: Image, least: np.float32
    ) -> tuple[Image, Image]:
        """Means of distances and their deviations, `least` or more, for samples (n, H, W)."""
        means, deviation = np.empty_like(distance), np.empty_like(distance)
        law = least, np.float32(_DOUBT), np.float32(self.error)
        samples = distance, sigma, positions
        team.share_frames(
            len(distance), kernels.unmix, *samples, self.bounds, self.ratio, *law, means, deviation
        )
        return means, deviation
