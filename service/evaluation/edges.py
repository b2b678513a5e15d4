"""How sharp a step in depth is."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from service.errors import UnmeasurableError
from service.evaluation.figures import plane_in
from service.evaluation.sight import Sight

Mask = NDArray[np.bool_]
Float = NDArray[np.float64]

_FLANK = 6.0
"""Pixels of a frame to either side of the edge that are looked at."""

_WIDEST_GAP = 12.0
"""Pixels of a frame between the two regions beyond which it is not said that one edge lies between them."""

_LEAST_LINES = 8
"""Rows or columns of a frame that have to cross the edge."""

_BIN = 0.1
"""Width in pixels of the bins of the profile; the four to a pixel of ISO 12233 widen sharp edges by 5 %."""

_MOST_CROOKED = 0.75
"""Pixels of a frame (RMS) by which the edge may leave a straight line."""

_LEAST_CONTRAST = 4.0
"""Step over the deviation from either plane, both along the rays, below which the profile is noise."""


@dataclass(frozen=True)
class EdgeProfile:
    """A step in depth, across.

    Attributes:
        place: (B,) metres across the edge, at the nearer side's distance; 0 = where it is half.
        level: (B,) 0 on the first region's plane, 1 on the second's.
        width: from 10 to 90 %, metres.
    """

    place: Float
    level: Float
    width: float


def edge_profile(sight: Sight, first: Mask, second: Mask, factor: int) -> EdgeProfile:
    """The profile across the straight edge between two regions, many rows brought onto one.

    The level of a pixel is its distance between those at which its ray meets the planes of the two regions.
    Source: the slanted edge of ISO 12233; its rise from 10 to 90 % for a width.

    Args:
        sight: the image.
        first, second: (H, W) in its pixels.
        factor: its pixels per pixel of a frame.

    Raises:
        UnmeasurableError: no straight edge lies between them, or its step is lost in the noise.
    """
    near, far = plane_in(sight, first), plane_in(sight, second)
    between = _between(first, second, factor) & sight.known
    ends = near.distances(sight.rays), far.distances(sight.rays)
    height = float(np.median(np.abs(ends[1] - ends[0])[between])) if between.any() else 0.0
    rough = max(_rough(sight, mask, end) for mask, end in zip((first, second), ends, strict=True))
    if height < _LEAST_CONTRAST * rough:
        raise UnmeasurableError(
            f"the step between the regions is lost in the noise: {height * 1e3:.1f} mm against "
            f"{rough * 1e3:.1f} mm"
        )
    level = (sight.distance - ends[0]) / (ends[1] - ends[0])
    across = _across(level, between, factor)
    place, profile = _binned(across[between], level[between])
    width = _rise(place, profile)
    distance = np.minimum(*ends)[between]
    pitch = float(np.median(distance)) / float(np.sqrt(sight.intrinsics[0, 0] * sight.intrinsics[1, 1]))
    return EdgeProfile(place * pitch, profile, width * pitch)


def _rough(sight: Sight, mask: Mask, plane: Float) -> float:
    """RMS of the distances in a region about those of its plane, metres."""
    seen = mask & sight.known
    return float(np.sqrt(np.mean((sight.distance[seen] - plane[seen]) ** 2)))


def _between(first: Mask, second: Mask, factor: int) -> Mask:
    """Pixels between the regions, and some of either beside the gap."""
    to = [
        cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for mask in (first, second)
    ]
    way = to[0] + to[1]
    gap = float(way.min())
    if gap > _WIDEST_GAP * factor:
        raise UnmeasurableError(f"the regions lie {gap / factor:.0f} pixels apart: no one edge between them")
    return np.asarray(way <= gap + _FLANK * factor)


def _across(level: Float, between: Mask, factor: int) -> Float:
    """(H, W) pixels to the straight line on which the level is one half, rising with it."""
    rows, columns = np.nonzero(between)
    side = np.where(level[between] > 0.5, 1.0, -1.0)
    slope = np.linalg.lstsq(np.column_stack([np.ones(len(rows)), rows, columns]), side, rcond=None)[0]
    upright = abs(slope[2]) >= abs(slope[1])
    lines = (level, between) if upright else (level.T, between.T)
    crossings = _crossings(*lines, rising=bool((slope[2] if upright else slope[1]) > 0))
    if len(crossings) < _LEAST_LINES * factor:
        raise UnmeasurableError("no edge that is long enough lies between the regions")
    offset, lean = _line(crossings, factor)
    i, j = np.indices(level.shape, dtype=np.float64)
    along, here = (i, j) if upright else (j, i)
    across = (here - offset - lean * along) / np.sqrt(1 + lean * lean)
    return np.asarray(across if (slope[2] if upright else slope[1]) > 0 else -across)


def _crossings(level: Float, between: Mask, *, rising: bool) -> Float:
    """(M, 2) row, and column at which it passes one half, of the rows that do so once."""
    found = []
    for row in np.nonzero(between.any(axis=1))[0]:
        columns = np.nonzero(between[row])[0]
        values = level[row, columns] if rising else 1 - level[row, columns]
        up = np.nonzero((values[:-1] < 0.5) & (values[1:] >= 0.5) & (np.diff(columns) == 1))[0]
        down = np.nonzero((values[:-1] >= 0.5) & (values[1:] < 0.5))[0]
        if len(up) == 1 and not len(down):
            low, high = values[up[0]], values[up[0] + 1]
            found.append((row, columns[up[0]] + (0.5 - low) / (high - low)))
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _line(crossings: Float, factor: int) -> tuple[float, float]:
    """Offset and slope of the line through them, outliers left out."""
    kept = crossings
    for _ in range(4):
        lean, offset = np.polyfit(kept[:, 0], kept[:, 1], 1)
        off = np.abs(crossings[:, 1] - offset - lean * crossings[:, 0])
        kept = crossings[off <= max(3 * 1.4826 * float(np.median(off)), 1e-6)]
    crooked = float(np.sqrt(np.mean((crossings[:, 1] - offset - lean * crossings[:, 0]) ** 2)))
    if crooked > _MOST_CROOKED * factor:
        raise UnmeasurableError(f"the edge is not straight: {crooked / factor:.1f} pixels off a line (RMS)")
    return float(offset), float(lean)


def _binned(across: Float, level: Float) -> tuple[Float, Float]:
    """Mean place and level of the pixels of each bin across the edge."""
    number = np.round(across / _BIN).astype(np.int64)
    kinds, members = np.unique(number, return_inverse=True)
    count = np.bincount(members)
    enough = count >= max(2, 0.2 * float(np.median(count)))
    place, value = (np.bincount(members, weights=values) / count for values in (across, level))
    assert len(kinds) == len(count)
    return place[enough], value[enough]


def _rise(place: Float, profile: Float) -> float:
    """From where the profile last leaves 10 % to where it first reaches 90 %, about its middle, in pixels."""
    middle = int(np.argmin(np.abs(place)))
    above = np.nonzero(profile[middle:] >= 0.9)[0]
    below = np.nonzero(profile[: middle + 1] <= 0.1)[0]
    if not len(above) or not len(below):
        raise UnmeasurableError("the edge does not rise from 10 to 90 % near its middle")
    return _reached(place, profile, middle + int(above[0]), 0.9) - _reached(
        place, profile, int(below[-1]) + 1, 0.1
    )


def _reached(place: Float, profile: Float, after: int, level: float) -> float:
    """Where the line from the bin before `after` to it passes a level."""
    if after == 0 or after >= len(place):
        return float(place[min(after, len(place) - 1)])
    low, high = profile[after - 1], profile[after]
    share = (level - low) / (high - low) if high > low else 0.5
    return float(place[after - 1] + np.clip(share, 0, 1) * (place[after] - place[after - 1]))
