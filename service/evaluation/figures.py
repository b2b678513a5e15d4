"""Figures of quality of a region: each of one image, or of several of the same view."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from service.errors import UnmeasurableError
from service.evaluation.planes import Plane, fit_plane
from service.evaluation.sight import Sight

Mask = NDArray[np.bool_]

LEAST_PIXELS = 30
"""Known pixels in a region from which a plane through them means something."""

MOST_SLANT = np.radians(10)
"""Angle between two planes up to which a step between them has a height."""


def plane_in(sight: Sight, mask: Mask) -> Plane:
    """The best plane through a region's known pixels; raises `UnmeasurableError` where there are too few."""
    return fit_plane(_points(sight, mask))


def flatness(sights: Sequence[Sight], mask: Mask) -> float:
    """Root mean square deviation from the best plane, metres; of several images the RMS over all.

    Source: ISO 12781-1, root mean square flatness deviation FLTq against the least squares plane.

    Raises:
        UnmeasurableError: too few known pixels.
    """
    squares = []
    for sight in sights:
        points = _points(sight, mask)
        squares.append(np.mean(fit_plane(points).deviations(points) ** 2))
    return float(np.sqrt(np.mean(squares)))


def fill(sights: Sequence[Sight], mask: Mask) -> float:
    """Share of a region's pixels that have a distance, 0 to 1; the mean over several images.

    Source: Intel RealSense, "Depth Camera Metrics: Definitions", fill rate.
    """
    return float(np.mean([sight.known[mask].mean() for sight in sights]))


def noise(sights: Sequence[Sight], mask: Mask) -> float:
    """Standard deviation in time of a pixel, metres: root of the mean over the pixels of their variances.

    Of pixels that are known in every image. Source: EMVA Standard 1288 release 4, section 4, temporal noise.

    Raises:
        UnmeasurableError: one image only, or no pixel known in all.
    """
    values = _repeated(sights, mask, "noise in time")
    return float(np.sqrt(np.mean(values.var(axis=0, ddof=1))))


def repeatability(sights: Sequence[Sight], mask: Mask) -> float:
    """Standard deviation from burst to burst of a region's mean distance, metres.

    Source: ISO 5725-2, repeatability standard deviation.

    Args:
        sights: one image of each burst.
        mask: (H, W).

    Raises:
        UnmeasurableError: one burst only, or no pixel known in all.
    """
    return float(_repeated(sights, mask, "repeatability").mean(axis=1).std(ddof=1))


def bias_of_plane(sights: Sequence[Sight], mask: Mask, true: float) -> float:
    """Perpendicular distance of the best plane minus the true one, metres; the mean over several images.

    Raises:
        UnmeasurableError: too few known pixels.
    """
    return float(np.mean([plane_in(sight, mask).offset - true for sight in sights]))


def bias_of_surface(sights: Sequence[Sight], mask: Mask, true: Plane) -> float:
    """Mean of measured minus true distance along the rays, metres, against a plane whose place is known.

    Raises:
        UnmeasurableError: too few known pixels.
    """
    found = []
    for sight in sights:
        seen = _seen(sight, mask)
        found.append(np.mean(sight.distance[seen] - true.distances(sight.rays[seen])))
    return float(np.mean(found))


def step(sights: Sequence[Sight], first: Mask, second: Mask) -> float:
    """Distance between the two parallel planes that fit two regions best, metres; the mean over images.

    Source: ISO 5436-1, step height by least squares with a common slope, here of planes.

    Raises:
        UnmeasurableError: too few known pixels, or regions that are not parallel.
    """
    return float(np.mean([_step(sight, first, second) for sight in sights]))


def _step(sight: Sight, first: Mask, second: Mask) -> float:
    groups = [_points(sight, mask) for mask in (first, second)]
    slant = float(np.arccos(np.clip(abs(fit_plane(groups[0]).normal @ fit_plane(groups[1]).normal), 0, 1)))
    if slant > MOST_SLANT:
        raise UnmeasurableError(
            f"the two regions are not parallel: {np.degrees(slant):.0f}° between them, expected at most "
            f"{np.degrees(MOST_SLANT):.0f}°"
        )
    centres = [group.mean(axis=0) for group in groups]
    away = np.concatenate([group - centre for group, centre in zip(groups, centres, strict=True)])
    normal = np.linalg.eigh(away.T @ away)[1][:, 0]
    return float(abs(normal @ (centres[1] - centres[0])))


def _repeated(sights: Sequence[Sight], mask: Mask, what: str) -> NDArray[np.float64]:
    """(N, P) distances of the pixels that are known in all images."""
    if len(sights) < 2:
        raise UnmeasurableError(f"{what} needs at least two bursts, or frames, of the same view")
    known = mask & np.all([sight.known for sight in sights], axis=0)
    if not known.any():
        raise UnmeasurableError("no pixel of the region has a distance every time")
    return np.stack([sight.distance[known] for sight in sights]).astype(np.float64)


def _points(sight: Sight, mask: Mask) -> NDArray[np.float64]:
    return sight.points(_seen(sight, mask))


def _seen(sight: Sight, mask: Mask) -> Mask:
    seen = mask & sight.known
    if seen.sum() < LEAST_PIXELS:
        raise UnmeasurableError(f"{seen.sum()} pixels of the region have a distance, expected {LEAST_PIXELS}")
    return seen
