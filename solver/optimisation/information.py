"""What is known of a map: the inverse variance of φ, by its samples and by what they say that it lacks."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import factors as kernels
from solver.optimisation.footprint import AreaTerm
from solver.runtime import team

Image = NDArray[np.floating]

_UNSURE, _TOLD, _FAR = 0.033, 0.7, 4.0
"""The variance of φ is 0.033 √β exp(0.7 D) n^¾ x^¼, by trial: n is the noise of the samples over a square of
the reach, x the squared second differences of the slopes, times the reach, and D the discrepancy times the
noise to `_NOISIER`, 4 at most: x tells the rest. A map that is smoothed best errs about alike by noise and by
relief that is lost, and both grow with either. By n alone it would be too sure where it is bright and too
timid where it is dim."""

_NOISIER = 0.15
"""Half-way between a discrepancy in units of agreement, which grows with the noise, and in units of noise."""

_ERRED = 0.0001 * 2 * np.pi / 7.5
"""What φ errs by however many samples there are."""


def doubt(ratio: Image, noise: float) -> Image:
    """What a discrepancy multiplies the variance by, where there is so much noise, as for `discrepancy`."""
    apart = np.minimum(ratio * np.float32(noise**_NOISIER), np.float32(_FAR))
    factor: Image = np.exp(np.float32(_TOLD) * apart)
    return factor


def information(z: Image, term: AreaTerm, variance: float, doubts: Image, bent: Image, reach: float) -> Image:
    """Inverse variance of φ, (rows, columns), 1 / radian².

    Args:
        z: (2, rows + 4, columns + 4), the phasors, padded.
        term: the data term.
        variance: of a sample's component.
        doubts: (rows, columns), as `doubt` gives them.
        bent: (rows, columns), radian², squared second differences of the slopes.
        reach: fused pixels, over which slopes are averaged.
    """
    out: Image = np.empty(bent.shape, np.float32)
    told = doubts * np.float32(_UNSURE * np.sqrt(term.factor) / reach)
    data = z, term.curvature, np.float32(1 / variance), bent, told, np.float32(_ERRED**2)
    team.share(kernels.informed, *data, out)
    return out
