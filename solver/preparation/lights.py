"""Near and far distances about an edge, and how bright the surfaces are, where the lights are known.

*Distances.* A sample of one surface alone is rare where laths lie side by side, and the median of a pixel's
samples y_k is mixed. So near is the third of all y_k + z σ_k from outside, and far that of all y_k − z σ_k,
of the samples that are sure. With Φ(−z) = (3 − ½) / N noise alone moves neither, and the more frames there
are, the purer is what they find. The outermost of nine pixels count.

*Lights.* A sample has the sum of two lights, p A₁ of the near surface and (1 − p) A₂ of the far one. It lies
by the part S of the way from far to near, so S A = p A₁ and (1 − S) A = (1 − p) A₂, and over all samples
about an edge

    1 / A = S / A₁ + (1 − S) / A₂,                                                       (1)

which least squares, each with weight A, solve for 1 / A₁ and 1 / A₂, so that a surface without mixed samples
has the mean of its lights; b = A₁ / A₂. No p has to be known. The less the samples tell, the more counts what
is likely: surfaces of the same paint, of which b = (far / near)².
"""

from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import shares as kernels
from solver.preparation.consensus import SURE
from solver.preparation.counts import Samples, around, clear, same_paint
from solver.runtime import team

Image = NDArray[np.float32]

_RANK = 3
"""Two samples on a pixel may be wrong; of three or four frames one."""

_DOUBT = 3.0
"""A sample counts where so many deviations span the way from near to far, but not where half do: noise alone
spans less."""

_LIKELY = 0.25
"""How many samples, on a pixel, what is likely counts for."""

_MOST = 5.0
"""|log b|: what differs more is as good as dark."""


def ends(
    distance: Image, sigma: Image, lost: float, positions: Image, bounds: tuple[Image, Image]
) -> tuple[Image, Image]:
    """Near and far (H, W) of samples (N, H, W); `bounds` of medians where too few are sure.

    Args:
        lost: deviation from which a sample says nothing.
        positions: (N, H, W, 2).
    """
    rank = min(_RANK, (len(distance) + 1) // 2)
    away = -NormalDist().inv_cdf((rank - 0.5) / len(distance))
    outer = np.empty((2, rank, *distance.shape[1:]), np.float32)
    law = np.float32(SURE * lost), np.float32(away)
    team.share(kernels.outermost, distance, sigma, *law, positions, outer)
    square = np.ones((3, 3), np.uint8)
    near, far = cv2.erode(outer[0, -1], square), -cv2.erode(outer[1, -1], square)
    return np.where(np.isfinite(near), near, bounds[0]), np.where(np.isfinite(far), far, bounds[1])


def ratio(samples: Samples, amplitude: Image, bounds: tuple[Image, Image]) -> Image:
    """(H, W), log b, between bounds (H, W), near and far; amplitude (N, H, W), linear in the light."""
    sums = np.empty((7, *amplitude.shape[1:]), np.float32)
    team.share(kernels.light_up, *samples, amplitude, bounds, np.float32(_DOUBT), sums)
    near, both, far, *parts = around(sums[2:])
    alike = same_paint(bounds)
    light = _LIKELY * (near + 2 * both + far) / np.maximum(parts[0] + parts[1], 1e-6)
    first, second = parts[0] + _LIKELY / np.sqrt(alike), parts[1] + _LIKELY * np.sqrt(alike)
    bright = (far + light) * first - both * second  # 1 / A₁
    dim = (near + light) * second - both * first  # 1 / A₂
    told = (bright > 0) & (dim > 0)
    found = np.log(np.where(told, dim, alike) / np.where(told, bright, 1))
    return np.where(clear(sums[:2]) > 0, np.clip(found, -_MOST, _MOST), 0).astype(np.float32)
