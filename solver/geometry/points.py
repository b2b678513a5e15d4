"""From distance to depth, points and normals, and the calibration of the fused image."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError
from solver.geometry.lens import (
    camera_matrix,
    lens_coefficients,
    pixel_rays,
    ray_lengths,
    rays_through,
    tilt_matrix,
)

_BEFORE, _AFTER = slice(None, -1), slice(1, None)


def depth_from_distance(
    distance: ArrayLike, intrinsics: ArrayLike, distortion: ArrayLike | None = None
) -> NDArray[np.float32]:
    """Z along the optical axis of each radial distance, (H, W) or (N, H, W) float32, the same unit.

    Z = distance / ‖(x, y, 1)‖ with (x, y) the pixel's undistorted ray. NaN stays NaN.

    Raises:
        FusionInputError: wrong shape, bad intrinsics or distortion.
    """
    image = _image(distance)
    lengths = ray_lengths((image.shape[-2], image.shape[-1]), intrinsics, distortion)
    return (image / lengths).astype(np.float32)


def distance_from_depth(
    depth: ArrayLike, intrinsics: ArrayLike, distortion: ArrayLike | None = None
) -> NDArray[np.float32]:
    """The inverse of `depth_from_distance`."""
    image = _image(depth)
    lengths = ray_lengths((image.shape[-2], image.shape[-1]), intrinsics, distortion)
    return (image * lengths).astype(np.float32)


def points_from_distance(
    distance: ArrayLike, intrinsics: ArrayLike, distortion: ArrayLike | None = None
) -> NDArray[np.float32]:
    """Points (x right, y down, z forward) of each pixel, (H, W, 3) or (N, H, W, 3) float32, the same unit."""
    depth = depth_from_distance(distance, intrinsics, distortion)
    rays = pixel_rays((depth.shape[-2], depth.shape[-1]), intrinsics, distortion)
    return np.stack([depth * rays[..., 0], depth * rays[..., 1], depth], axis=-1).astype(np.float32)


def normals_from_points(points: ArrayLike) -> NDArray[np.float32]:
    """Unit normals (H, W, 3) float32 that face the camera, NaN where a neighbour is missing.

    The cross product of the two tangents, each the shorter of its forward and backward differences, so that a
    normal beside a depth edge belongs to its own surface.

    Raises:
        FusionInputError: not (H, W, 3).
    """
    grid = np.asarray(points, dtype=np.float32)
    if grid.ndim != 3 or grid.shape[2] != 3:
        raise FusionInputError(f"points have shape {grid.shape}; expected (H, W, 3)")
    planes = np.ascontiguousarray(np.moveaxis(grid, 2, 0))  # so that sums over coordinates run along memory
    (x, y, z), (u, v, w) = _tangent(planes, axis=1), _tangent(planes, axis=2)
    normal = np.stack([y * w - z * v, z * u - x * w, x * v - y * u])
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.copysign(np.sqrt(dot(normal, normal)), -dot(normal, planes))
    return np.moveaxis(normal, 0, 2)


def dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Inner products of vectors whose coordinates are planes, (3, …) to (…)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def fused_intrinsics(intrinsics: ArrayLike, upsampling: int) -> NDArray[np.float64]:
    """The camera matrix of the fused image: f' = βf, c' = β(c + ½) − ½; the distortion is unchanged.

    Raises:
        FusionInputError: bad intrinsics, or β not a positive integer.
    """
    if upsampling != int(upsampling) or upsampling < 1:
        raise FusionInputError(f"upsampling is {upsampling}; expected a positive integer")
    K = camera_matrix(intrinsics).copy()
    K[0, 0] *= upsampling
    K[1, 1] *= upsampling
    K[:2, 2] = upsampling * (K[:2, 2] + 0.5) - 0.5
    return K


def rotations_to_shifts(
    rotations: ArrayLike,
    shape: tuple[int, int],
    intrinsics: ArrayLike,
    distortion: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Displacement (dy, dx) of the image centre for each rotation vector, (N, 2) low-resolution pixels.

    Raises:
        FusionInputError: not (N, 3), bad intrinsics or distortion.
    """
    from solver.geometry.positions import rotation_matrix
    from solver.kernels.distortion import distort  # only here: Numba takes long to import

    vectors = _rows("rotations", rotations, 3)
    K, lens = camera_matrix(intrinsics), lens_coefficients(distortion)
    centre = _centre(shape)
    rays = rotation_matrix(vectors) @ np.append(rays_through(centre, K, lens), 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    u, v = distort(x, y, lens)[:2]
    plane = np.stack([u, v, np.ones_like(u)], axis=-1) @ tilt_matrix(lens).T
    rows = plane[:, 1] / plane[:, 2] * K[1, 1] + K[1, 2]
    columns = plane[:, 0] / plane[:, 2] * K[0, 0] + K[0, 2]
    shifts: NDArray[np.float64] = np.stack([rows, columns], axis=-1) - centre
    shifts[rays[:, 2] <= 0] = np.nan
    return shifts


def shifts_to_rotations(
    shifts: ArrayLike,
    shape: tuple[int, int],
    intrinsics: ArrayLike,
    distortion: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Rotation vectors (N, 3) without roll that displace the image centre by (dy, dx).

    The inverse of `rotations_to_shifts` on its range: the shortest rotation that takes the ray of the centre
    to the ray that looks at the displaced centre.

    Raises:
        FusionInputError: not (N, 2), bad intrinsics or distortion.
    """
    moves = _rows("shifts", shifts, 2)
    K, lens = camera_matrix(intrinsics), lens_coefficients(distortion)
    centre = _centre(shape)
    start, ends = _unit(rays_through(centre, K, lens)), _unit(rays_through(centre + moves, K, lens))
    axes = np.cross(start, ends)
    sines = np.linalg.norm(axes, axis=1)
    angles = np.arctan2(sines, ends @ start)
    vectors: NDArray[np.float64] = axes * (angles / np.where(sines > 0, sines, 1))[:, None]
    return vectors


def _rows(name: str, values: ArrayLike, length: int) -> NDArray[np.float64]:
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != length:
        raise FusionInputError(f"{name} have shape {rows.shape}; expected (N, {length})")
    return rows


def _centre(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Row and column of the image centre, where the displacement of a rotation is told."""
    return np.array([(shape[0] - 1) / 2, (shape[1] - 1) / 2])


def _unit(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (..., 3) of rays (..., 2) at z = 1."""
    vectors = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _tangent(points: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """The shorter of the differences to both neighbours, (3, H, W), along `axis`."""
    beyond = [(0, 0), (0, 0), (0, 0)]
    beyond[axis] = (1, 1)
    steps = np.pad(np.diff(points, axis=axis), beyond, constant_values=np.nan)
    lengths = dot(steps, steps)
    backward, forward = (np.moveaxis(steps, axis, 1)[:, side] for side in (_BEFORE, _AFTER))
    b, f = (np.moveaxis(lengths, axis - 1, 0)[side] for side in (_BEFORE, _AFTER))
    return np.moveaxis(np.where((f <= b) | np.isnan(b), forward, backward), 1, axis)


def _image(values: ArrayLike) -> NDArray[np.float64]:
    image = np.asarray(values, dtype=np.float64)
    if image.ndim not in (2, 3):
        raise FusionInputError(f"image has shape {image.shape}; expected (H, W) or (N, H, W)")
    return image
