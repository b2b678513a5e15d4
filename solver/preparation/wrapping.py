"""Where the circle of distances is cut, so that what is around the end of the ambiguity range stays together.

A distance is an angle. What is farther than the range seems to be next to the camera, and noise carries what
is near the end across it; methods that average distances take both for what they say. So the circle is cut
where nothing is, or least: what seems nearer than the cut is taken to be a whole range farther.
"""

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

_PARTS = 24
"""Of the range, in which samples are counted; a sample with a deviation of more than one is not."""

_NONE, _LESS = 1e-3, 0.25
"""The part of the samples that is as good as none: wild ones are spread over the whole range. Where no part
has so few, the one that has least is taken, if that is under a quarter of what is at either end."""

_THINNED = 3
"""One pixel in so many squared is counted."""


def find_cut(distance: Image, sigma: Image, ambiguity_range: float) -> float:
    """The distance under which samples (N, H, W) lie beyond the range.

    0 where nothing is near its end, and where no part of it has clearly less than that.
    """
    thinned = np.s_[:, ::_THINNED, ::_THINNED]
    told = distance[thinned][sigma[thinned] <= ambiguity_range / _PARTS]
    count = np.histogram(told, _PARTS, (0.0, ambiguity_range))[0]
    none = _NONE * count.sum()
    if count.min() < _LESS * min(count[0], count[-1]):
        none = max(none, count.min())
    empty = np.flatnonzero(count <= none)
    if not empty.size or empty[-1] == _PARTS - 1:
        return 0.0
    return float(empty[0] + 1) * ambiguity_range / _PARTS


def nearest(ambiguity_range: float, cut: float) -> float:
    """What nothing is nearer than, for all that is known."""
    return max(cut, ambiguity_range / _PARTS)


def unwrapped(distance: Image, cut: float, ambiguity_range: float | None) -> Image:
    """The distances from the cut up to a whole range more; the same array where there is no cut."""
    if not cut or ambiguity_range is None:
        return distance
    with np.errstate(invalid="ignore"):
        return np.where(distance < cut, distance + np.float32(ambiguity_range), distance)


def wrapped(distance: Image, cut: float, ambiguity_range: float | None) -> Image:
    """From 0 up to the range again; the same array where there is no cut."""
    if not cut or ambiguity_range is None:
        return distance
    with np.errstate(invalid="ignore"):
        return np.mod(distance, np.float32(ambiguity_range))
