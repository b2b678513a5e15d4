"""A fused map as a surface, seen from the side: what tells sharp edges from smeared ones at a glance."""

import numpy as np
from numpy.typing import NDArray

from drivers.rotations import rotation_matrix
from solver.geometry.points import dot, normals_from_points, points_from_distance

_AMBIENT = 0.25
_SIZE = 432, 353
"""Columns and rows of the picture, and pixels of the map that it has room for."""

_GRAZING = 0.12
"""Cosine to the ray below which a pixel belongs to no surface, but spans the gap between two."""

_LIGHT = np.array([0.35, -0.5, -1.0], np.float32)
"""Where it comes from, in the viewer's axes."""

_SAMPLED = 7
"""Of how many points one is looked at to see how far they reach."""

_SMOOTHING = 3
"""Pixels over which normals are averaged: from one pixel to the next, noise turns them by tens of degrees."""


class Surface:
    """The surface of a map, to be seen from several viewpoints.

    Args:
        distance: (H, W) radial, NaN = unknown.
        intrinsics, distortion: of that image.
    """

    def __init__(
        self,
        distance: NDArray[np.float32],
        intrinsics: NDArray[np.float64],
        distortion: tuple[float, ...] | None,
    ) -> None:
        step = max(1, -(-distance.shape[1] // _SIZE[0]))
        scaled = np.diag([1 / step, 1 / step, 1.0]) @ intrinsics
        points = points_from_distance(distance[::step, ::step], scaled, distortion)
        normals = np.moveaxis(normals_from_points(points), 2, 0)
        points = np.ascontiguousarray(np.moveaxis(points, 2, 0))
        known = np.isfinite(points[2]) & np.isfinite(normals[0]) & ~_grazed(points, normals)
        self._points = points[:, known]
        self._normals = _smoothed(normals, known)[:, known]
        sampled = self._points[:, ::_SAMPLED]
        self._middle = np.median(sampled, axis=1)[:, None] if known.any() else np.zeros((3, 1), np.float32)

    def seen_from(self, yaw: float, pitch: float) -> NDArray[np.float32]:
        """Render it in grey from a viewpoint turned about the scene's middle.

        Lambert's law with a light beside the viewer; the nearest of the points that fall on a pixel is seen.

        Args:
            yaw, pitch: radians the viewer goes right and up.

        Returns:
            (rows, columns) float32, 0..1, NaN where nothing is seen.
        """
        if not self._points.size:
            return np.full((2, 2), np.nan, np.float32)
        turn = (rotation_matrix((0.0, yaw, 0.0)) @ rotation_matrix((pitch, 0.0, 0.0))).astype(np.float32)
        seen = turn @ (self._points - self._middle)
        facing = (_LIGHT / np.linalg.norm(_LIGHT)) @ turn @ self._normals
        value = (_AMBIENT + (1 - _AMBIENT) * np.clip(facing, 0, 1)).astype(np.float32)
        return _splat(seen, value, float(self._middle[2, 0]))


def _grazed(points: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray(dot(points, normals) ** 2 < _GRAZING**2 * dot(points, points))


def _smoothed(normals: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    import cv2

    kept = np.where(known, normals, np.float32(0))
    mean = np.stack([cv2.blur(plane, (_SMOOTHING, _SMOOTHING)) for plane in kept])
    return np.asarray(mean / np.maximum(np.sqrt(dot(mean, mean)), np.finfo(np.float32).tiny))


def _splat(points: NDArray[np.floating], value: NDArray[np.float32], away: float) -> NDArray[np.float32]:
    """Points (3, M) in the viewer's axes about the scene's middle, `away` metres off, far ones first."""
    import cv2

    columns, rows = _SIZE
    depth = points[2] + away
    front = depth > 0.1 * away
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = points[:2] / depth
    # The few farthest points would make the rest small.
    low, high = np.percentile(plane[:, ::_SAMPLED][:, front[::_SAMPLED]], (0.5, 99.5), axis=1)
    scale = 0.92 * float(min(columns / (high[0] - low[0]), rows / (high[1] - low[1])))
    middle = (low + high) / 2
    column, row = (scale * (plane[k] - middle[k]) + size / 2 for k, size in enumerate(_SIZE))
    inside = front & (column >= 0) & (column < columns - 1) & (row >= 0) & (row < rows - 1)
    column, row = column[inside].astype(np.int32), row[inside].astype(np.int32)
    value, depth = value[inside], depth[inside]
    # Far ones first, so that of several the nearest stays; sixteen bits sort by radix, in no time.
    steps = (depth.max() - depth) * (65535 / max(float(np.ptp(depth)), 1e-6))
    order = np.argsort(steps.astype(np.uint16), kind="stable")
    nearness = np.zeros((rows, columns), np.float32)
    nearness[row[order], column[order]] = np.arange(1, len(order) + 1)
    # Each point covers two by two pixels, so that a surface seen askew has no gaps.
    covering = cv2.dilate(nearness, np.ones((2, 2), np.uint8), anchor=(1, 1)).astype(np.int32)
    shown: NDArray[np.float32] = np.append(np.float32(np.nan), value[order])[covering]
    return shown
