"""Planes through points, and flat parts of an image."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Points = NDArray[np.float64]

LEAST_SHARE = 0.03
"""Of the image that a plane has to fill."""

_MOST_PLANES = 6

_SEEDS, _WINDOW = 150, 11
"""Places at which a plane is begun, and the side of the square of pixels that it is begun with."""

_REACH = 4.0
_LEAST_TOLERANCE = 6e-3
"""How far a pixel of a plane may lie off it: so many deviations of the noise, and at least this part of its
distance, for the systematic errors of such cameras bend walls by as much."""

_MARGIN = 2
"""Pixels at the rim of a plane that are left out: they mix with what is beside it."""

_BEND = 0.01
"""Of a flat part's side by which it may be bent at most (RMS of the best quadratic in its deviations): a wall
that systematic errors bend by centimetres stays below, a part of a sphere does not."""

_GRAZING = 0.12
"""Cosine between the rays and the normal of a plane below which it belongs to no surface."""

_SPECK = 40
"""Pixels of a hole in a plane that is taken for part of it, whatever was measured there."""


@dataclass(frozen=True)
class Plane:
    """normal · P = offset for its points P.

    Attributes:
        normal: (3,) unit vector, away from the camera.
        offset: perpendicular distance from the projection centre, metres.
    """

    normal: NDArray[np.float64]
    offset: float

    def deviations(self, points: Points) -> NDArray[np.float64]:
        """Perpendicular distances of (…, 3) points from the plane, metres, > 0 behind it."""
        return np.asarray(points @ self.normal - self.offset)

    def distances(self, rays: Points) -> NDArray[np.float64]:
        """Distances at which (…, 3) unit rays meet it, metres."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.offset / (rays @ self.normal))


def fit_plane(points: Points) -> Plane:
    """The plane of least squared perpendicular distances through (P, 3) points, at least three.

    Source: ISO 12781-1, least squares reference plane; by the singular value decomposition of the points
    about their mean (Shakarji, J. Res. NIST 103, 1998, section 4).
    """
    centre = points.mean(axis=0)
    away = points - centre
    normal = np.linalg.eigh(away.T @ away)[1][:, 0]
    offset = float(normal @ centre)
    return Plane(normal, offset) if offset >= 0 else Plane(-normal, -offset)


def find_planes(points: Points) -> Iterator[Mask]:
    """Flat parts of an image, the largest first, without their rims.

    Planes begun with small squares of pixels grow over all pixels that lie on them and hang together
    (random sample consensus: Fischler and Bolles, CACM 24, 1981); the largest is taken out, and so on.

    Args:
        points: (H, W, 3) metres, NaN = unknown.

    Yields:
        (H, W) masks; pixels enclosed by a plane belong to it, known or not.
    """
    known = np.isfinite(points[..., 2])
    points = np.where(known[..., None], points, 0.0)
    free = known.copy()
    for _ in range(_MOST_PLANES):
        found = _largest(points, free)
        if found is None:
            return
        free &= ~_grown(found, _MARGIN)
        if not (_is_bent(points[found]) or _is_grazed(points[found])):
            inner = _shrunk(_filled(found, known), _MARGIN)
            if inner.mean() >= LEAST_SHARE / 2:
                yield inner


def _largest(points: Points, free: Mask) -> Mask | None:
    """The largest part of what is free that lies on one plane; None where none is large enough."""
    seeds = list(_seeds(points, free))
    if not seeds:
        return None
    noise = float(np.percentile([rms for _, _, rms in seeds], 25))
    grown = sorted(
        (_part(points, free, plane, place, noise) for place, plane, _ in seeds),
        key=lambda part: int(part.sum()),
        reverse=True,
    )
    best = max((_refined(points, free, part, noise) for part in grown[:8]), key=lambda part: int(part.sum()))
    return best if best.mean() >= LEAST_SHARE else None


def _seeds(points: Points, free: Mask) -> Iterator[tuple[tuple[int, int], Plane, float]]:
    """Place, plane and RMS of small squares all over what is free."""
    half = _WINDOW // 2
    whole = _shrunk(free, 2)
    rows, columns = np.nonzero(whole[half:-half, half:-half])
    random = np.random.default_rng(0)
    for place in random.permutation(len(rows))[:_SEEDS]:
        i, j = int(rows[place]), int(columns[place])
        window = np.s_[i : i + _WINDOW, j : j + _WINDOW]
        inside = points[window][free[window]]
        if len(inside) >= _WINDOW**2 // 2:
            plane = fit_plane(inside)
            yield (i + half, j + half), plane, _rms(plane.deviations(inside))


def _part(points: Points, free: Mask, plane: Plane, place: tuple[int, int], noise: float) -> Mask:
    """What is free, lies on the plane and hangs together with a place."""
    tolerance = np.maximum(_REACH * noise, _LEAST_TOLERANCE * points[..., 2])
    on = free & (np.abs(plane.deviations(points)) < tolerance)
    _, labels = cv2.connectedComponents(on.astype(np.uint8), connectivity=4)
    return np.asarray(on & (labels == labels[place]) if on[place] else np.zeros_like(on))


def _refined(points: Points, free: Mask, part: Mask, noise: float) -> Mask:
    """The part, grown by the plane through all of it."""
    for _ in range(6):
        if part.sum() < _WINDOW**2 // 2:
            return part
        rows, columns = np.nonzero(part)
        middle = np.hypot(rows - np.median(rows), columns - np.median(columns)).argmin()
        place = int(rows[middle]), int(columns[middle])
        larger = _part(points, free, fit_plane(points[part]), place, noise)
        if larger.sum() <= part.sum():
            break
        part = larger
    return part


def _is_bent(points: Points) -> bool:
    """Whether the deviations from the plane bend more than those of a wall seen by a camera that errs."""
    plane = fit_plane(points)
    away = points - points.mean(axis=0)
    axes = np.linalg.eigh(away.T @ away)[1][:, 1:]
    u, v = (away @ axes).T
    side = 4 * np.sqrt(u.std() * v.std())
    terms = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    deviations = plane.deviations(points)
    bend = terms @ np.linalg.lstsq(terms, deviations, rcond=None)[0]
    return bool(_rms(bend) > _BEND * side)


def _is_grazed(points: Points) -> bool:
    """Whether the rays run along the plane: it is the gap between two surfaces, filled in."""
    cosines = np.abs(points @ fit_plane(points).normal) / np.linalg.norm(points, axis=1)
    return bool(np.median(cosines) < _GRAZING)


def _filled(part: Mask, known: Mask) -> Mask:
    """The part with its small holes, and those in which nothing was measured."""
    closed = cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    outside = 1 - closed
    count, labels = cv2.connectedComponents(outside, connectivity=4)
    rim = set(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]).tolist())
    for number in range(1, count):
        hole = labels == number
        if number not in rim and (hole.sum() <= _SPECK or known[hole].mean() < 0.2):
            closed[hole] = 1
    return closed.astype(bool)


def _grown(mask: Mask, by: int) -> Mask:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)).astype(bool)


def _shrunk(mask: Mask, by: int) -> Mask:
    return cv2.erode(mask.astype(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)).astype(bool)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
