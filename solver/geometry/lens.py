"""OpenCV's lens model: pixels to rays and back.

Source: OpenCV, "Camera Calibration and 3D Reconstruction" (rational, tangential, thin-prism model with a
tilted sensor); the inverse has no closed form and is found by Newton's method.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError

Float = NDArray[np.float64]

_COEFFICIENTS = (4, 5, 8, 12, 14)


def camera_matrix(intrinsics: ArrayLike) -> Float:
    """Check a 3 × 3 camera matrix and return it as float64.

    Raises:
        FusionInputError: wrong shape, not finite, focal length not positive, or skew.
    """
    K = np.asarray(intrinsics, dtype=np.float64)
    if K.shape != (3, 3):
        raise FusionInputError(f"intrinsics have shape {K.shape}; expected (3, 3)")
    if not np.isfinite(K).all():
        raise FusionInputError("intrinsics hold NaN or infinity; expected nine finite numbers")
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise FusionInputError(f"focal lengths are {K[0, 0]:g}, {K[1, 1]:g}; expected positive pixels")
    if K[0, 1] or K[1, 0] or K[2, 0] or K[2, 1] or K[2, 2] != 1:
        raise FusionInputError("intrinsics must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] (no skew)")
    return K


def lens_coefficients(distortion: ArrayLike | None) -> Float:
    """Check OpenCV distortion coefficients and return all fourteen (zeros where not given).

    Raises:
        FusionInputError: not 4, 5, 8, 12 or 14 finite numbers.
    """
    full = np.zeros(14)
    if distortion is None:
        return full
    given = np.asarray(distortion, dtype=np.float64).ravel()
    if given.size == 0:
        return full
    if given.size not in _COEFFICIENTS or not np.isfinite(given).all():
        raise FusionInputError(
            f"distortion holds {given.size} numbers; expected 4, 5, 8, 12 or 14 finite OpenCV coefficients"
        )
    full[: given.size] = given
    return full


def tilt_matrix(coefficients: Float) -> Float:
    """The homography of a tilted sensor (τx, τy), identity where both are zero."""
    tx, ty = coefficients[12:14]
    cx, sx, cy, sy = np.cos(tx), np.sin(tx), np.cos(ty), np.sin(ty)
    rotation = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array(
        [[1, 0, 0], [0, cx, sx], [0, -sx, cx]]
    )
    project = np.array(
        [[rotation[2, 2], 0, -rotation[0, 2]], [0, rotation[2, 2], -rotation[1, 2]], [0, 0, 1]]
    )
    tilt: Float = project @ rotation
    return tilt


def pixel_rays(shape: tuple[int, int], intrinsics: ArrayLike, distortion: ArrayLike | None = None) -> Float:
    """Undistorted rays (x, y) at z = 1 through every pixel centre, (H, W, 2) float64, read-only.

    Raises:
        FusionInputError: bad intrinsics or distortion, or a lens model that folds inside the image.
    """
    K, lens = camera_matrix(intrinsics), lens_coefficients(distortion)
    return _rays(shape, tuple(K.ravel().tolist()), tuple(lens.tolist()))


@lru_cache(maxsize=8)  # a session has one camera at low and fused resolution; undistorting costs milliseconds
def _rays(shape: tuple[int, int], intrinsics: tuple[float, ...], lens: tuple[float, ...]) -> Float:
    K, coefficients = np.array(intrinsics).reshape(3, 3), np.array(lens)
    rays = rays_through(np.moveaxis(np.indices(shape, dtype=np.float64), 0, -1), K, coefficients)
    rays.setflags(write=False)
    return rays


def ray_lengths(shape: tuple[int, int], intrinsics: ArrayLike, distortion: ArrayLike | None = None) -> Float:
    """‖(x, y, 1)‖ of those rays, (H, W) float64, read-only; raises as `pixel_rays`."""
    K, lens = camera_matrix(intrinsics), lens_coefficients(distortion)
    return _lengths(shape, tuple(K.ravel().tolist()), tuple(lens.tolist()))


@lru_cache(maxsize=4)  # every map needs them
def _lengths(shape: tuple[int, int], intrinsics: tuple[float, ...], lens: tuple[float, ...]) -> Float:
    rays = _rays(shape, intrinsics, lens)
    lengths: Float = np.sqrt(1.0 + rays[..., 0] ** 2 + rays[..., 1] ** 2)
    lengths.setflags(write=False)
    return lengths


def rays_through(positions: Float, intrinsics: Float, coefficients: Float) -> Float:
    """Undistorted rays (x, y) at z = 1 through image positions (row, column), (..., 2) to (..., 2) float64.

    Raises:
        FusionInputError: the lens model folds at one of the positions.
    """
    K = intrinsics
    x = (positions[..., 1] - K[0, 2]) / K[0, 0]
    y = (positions[..., 0] - K[1, 2]) / K[1, 1]
    image: Float = np.stack([x, y], axis=-1)
    if not coefficients.any():
        return image
    # The tilt acts last, so it is undone first.
    plane = np.concatenate([image, np.ones((*image.shape[:-1], 1))], axis=-1)
    plane = plane @ np.linalg.inv(tilt_matrix(coefficients)).T
    from solver.kernels.distortion import undistort  # only here: Numba takes long to import

    rays: Float = undistort((plane[..., :2] / plane[..., 2:]).reshape(-1, 2), coefficients)
    if not np.isfinite(rays).all():
        raise FusionInputError(
            "the lens distortion cannot be inverted inside the image; check the distortion coefficients"
        )
    return rays.reshape(image.shape)
