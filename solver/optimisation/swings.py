"""Where a map swings instead of showing a scene.

Samples that contradict each other are met by deconvolution all the same: by swings many times as large as
what they differ by. Weights that took these for edges would free them, and what is left of the problem is all
but singular: such passes took a thousand iterations and more. A scene's edges lie apart; swings fill an area.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels.group import PAD

Image = NDArray[np.floating]

_AROUND = 21
"""Side of the square in which edges are counted, fused pixels."""

_EDGES = (0.7, 0.8)
"""The part of edges in it from which on they are taken for swings, and at which they all are. Two depth maps
and two recordings, at several noise levels and from 4 frames up, have at most 0.68."""


def find_swings(norms: Image, epsilon: float) -> Image | None:
    """How much of a map is swings, 0 = none to 1, by pixel (rows + 4, columns + 4); None = nowhere any.

    Args:
        norms: (rows + 4, columns + 4) of a padded map's differences.
        epsilon: the norm that is half an edge.
    """
    squares = norms[PAD:-PAD, PAD:-PAD] / epsilon
    squares *= squares
    squares /= 1 + squares
    edges = cv2.blur(squares, (_AROUND, _AROUND), borderType=cv2.BORDER_REFLECT)
    if edges.max() <= _EDGES[0]:
        return None
    return np.pad(np.clip((edges - _EDGES[0]) / (_EDGES[1] - _EDGES[0]), 0, 1), PAD).astype(norms.dtype)
