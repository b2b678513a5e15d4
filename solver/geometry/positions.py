"""Where each pixel of each frame looks, in low-resolution pixels of frame 0."""

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError
from solver.geometry.lens import camera_matrix, lens_coefficients, pixel_rays, tilt_matrix
from solver.kernels.lens import distort
from solver.runtime import team


def sample_positions(
    shape: tuple[int, int, int],
    *,
    shifts: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    intrinsics: ArrayLike | None = None,
    distortion: ArrayLike | None = None,
) -> NDArray[np.float32]:
    """Positions (row, column) in frame 0 at which every pixel looks.

    Pixel (i, j) of frame k looks where pixel (i + dy, j + dx) of frame 0 looks. A rotation takes frame k's
    ray to frame 0's: undistort, rotate, distort again; a pinhole camera moves by the homography K R K⁻¹.

    Args:
        shape: (N, H, W) of the frames.
        shifts: (N, 2) displacements (dy, dx) in low-resolution pixels.
        rotations: (N, 3) rotation vectors in radians (x right, y down, z forward); needs `intrinsics`.
        intrinsics: 3 × 3 camera matrix in low-resolution pixels.
        distortion: OpenCV coefficients.

    Returns:
        (N, H, W, 2) float32; NaN where a rotation turns a pixel's ray out of the camera's half-space.

    Raises:
        FusionInputError: both or neither of shifts and rotations, wrong shapes, NaN, or no intrinsics.
    """
    if (shifts is None) == (rotations is None):
        raise FusionInputError("give either shifts (N, 2) or rotations (N, 3), and not both")
    if shifts is not None:
        return _shifted(shape, _checked("shifts", shifts, (shape[0], 2)))
    turns = _checked("rotations", rotations, (shape[0], 3))
    if intrinsics is None:
        raise FusionInputError("rotations need the camera's intrinsics (3 × 3) to become pixel positions")
    return rotated_positions(turns, shape[1:], intrinsics, distortion)


def rotated_positions(
    rotations: NDArray[np.float64],
    shape: tuple[int, int],
    intrinsics: ArrayLike,
    distortion: ArrayLike | None,
) -> NDArray[np.float32]:
    """Positions (N, H, W, 2) for rotation vectors (N, 3) that are known to be finite."""
    K, lens = camera_matrix(intrinsics), lens_coefficients(distortion)
    matrices = rotation_matrix(rotations)
    rays = pixel_rays(shape, K, lens)
    positions = np.empty((len(rotations), *shape, 2), dtype=np.float32)
    team.share_frames(
        len(matrices), _project, rays, matrices, K, lens, tilt_matrix(lens), bool(lens.any()), positions
    )
    return positions


def rotation_matrix(vector: ArrayLike) -> NDArray[np.float64]:
    """Rodrigues' formula: 3 × 3 matrices (..., 3, 3) of rotation vectors (..., 3) in radians."""
    turn = np.asarray(vector, dtype=np.float64)
    matrices = np.empty((turn.size // 3, 3, 3))
    _rodrigues(np.ascontiguousarray(turn).reshape(-1, 3), matrices)
    return matrices.reshape(*turn.shape, 3)


def rotation_vector(matrix: ArrayLike) -> NDArray[np.float64]:
    """Rotation vectors (..., 3) in radians of matrices (..., 3, 3) that turn by less than half a turn."""
    R = np.asarray(matrix, dtype=np.float64)
    vectors = np.empty((R.size // 9, 3))
    _unwind(np.ascontiguousarray(R).reshape(-1, 3, 3), vectors)
    return vectors.reshape(R.shape[:-1])


@numba.njit(cache=True)
def _rodrigues(vectors, matrices):  # type: ignore[no-untyped-def]
    for k in range(len(vectors)):
        x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
        angle = np.sqrt(x * x + y * y + z * z)
        # (1 − cos a)/a² = ½ (sin(a/2)/(a/2))², which does not cancel where a is small.
        sine = np.sin(angle) / angle if angle > 0.0 else 1.0
        half = np.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0
        bend = 0.5 * half * half
        R = matrices[k]
        R[0, 0], R[1, 1] = 1 - bend * (y * y + z * z), 1 - bend * (x * x + z * z)
        R[2, 2] = 1 - bend * (x * x + y * y)
        R[0, 1], R[1, 0] = bend * x * y - sine * z, bend * x * y + sine * z
        R[0, 2], R[2, 0] = bend * x * z + sine * y, bend * x * z - sine * y
        R[1, 2], R[2, 1] = bend * y * z - sine * x, bend * y * z + sine * x


@numba.njit(cache=True)
def _unwind(matrices, vectors):  # type: ignore[no-untyped-def]
    for k in range(len(matrices)):
        R = matrices[k]
        x, y, z = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
        sine = np.sqrt(x * x + y * y + z * z)
        angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1))
        scale = angle / sine if sine > 1e-12 else 1.0
        vectors[k, 0], vectors[k, 1], vectors[k, 2] = scale * x, scale * y, scale * z


def _checked(name: str, values: ArrayLike | None, shape: tuple[int, int]) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise FusionInputError(f"{name} have shape {array.shape}; expected {shape}, one row per frame")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1)).tolist()
        raise FusionInputError(f"{name} of frames {bad} hold NaN or infinity; expected finite numbers")
    return array


def _shifted(shape: tuple[int, int, int], shifts: NDArray[np.float64]) -> NDArray[np.float32]:
    count, height, width = shape
    positions = np.empty((count, height, width, 2), dtype=np.float32)
    positions[..., 0] = np.arange(height)[None, :, None] + shifts[:, 0, None, None]
    positions[..., 1] = np.arange(width)[None, None, :] + shifts[:, 1, None, None]
    return positions


@numba.njit(cache=True, nogil=True)
def _project(rank, size, rays, matrices, K, lens, tilt, distorted, positions):  # type: ignore[no-untyped-def]
    height, width = rays.shape[:2]
    lines = matrices.shape[0] * height
    for item in range(rank * lines // size, (rank + 1) * lines // size):
        k, i = item // height, item % height
        R = matrices[k]
        for j in range(width):
            a, b = rays[i, j, 0], rays[i, j, 1]
            z = R[2, 0] * a + R[2, 1] * b + R[2, 2]
            if z <= 0.0:
                positions[k, i, j, 0] = np.nan
                positions[k, i, j, 1] = np.nan
                continue
            x = (R[0, 0] * a + R[0, 1] * b + R[0, 2]) / z
            y = (R[1, 0] * a + R[1, 1] * b + R[1, 2]) / z
            if distorted:
                u, v = distort(x, y, lens)[:2]
                w = tilt[2, 0] * u + tilt[2, 1] * v + tilt[2, 2]
                x = (tilt[0, 0] * u + tilt[0, 1] * v + tilt[0, 2]) / w
                y = (tilt[1, 0] * u + tilt[1, 1] * v + tilt[1, 2]) / w
            positions[k, i, j, 0] = y * K[1, 1] + K[1, 2]
            positions[k, i, j, 1] = x * K[0, 0] + K[0, 2]
