"""Where each pixel of each frame looks, in low-resolution pixels of frame 0."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError
from solver.geometry.lens import camera_matrix, lens_coefficients, pixel_rays, tilt_matrix
from solver.kernels.rotation import project, rotation_matrices, rotation_vectors
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
    vectors = _checked("rotations", rotations, (shape[0], 3))
    if intrinsics is None:
        raise FusionInputError("rotations need the camera's intrinsics (3 × 3) to become pixel positions")
    return rotated_positions(vectors, shape[1:], intrinsics, distortion)


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
        len(matrices), project, rays, matrices, K, lens, tilt_matrix(lens), bool(lens.any()), positions
    )
    return positions


def rotation_matrix(vector: ArrayLike) -> NDArray[np.float64]:
    """Rodrigues' formula: 3 × 3 matrices (..., 3, 3) of rotation vectors (..., 3) in radians."""
    vectors = np.asarray(vector, dtype=np.float64)
    matrices = np.empty((vectors.size // 3, 3, 3))
    rotation_matrices(np.ascontiguousarray(vectors).reshape(-1, 3), matrices)
    return matrices.reshape(*vectors.shape, 3)


def rotation_vector(matrix: ArrayLike) -> NDArray[np.float64]:
    """Rotation vectors (..., 3) in radians of matrices (..., 3, 3) that turn by less than half a turn."""
    R = np.asarray(matrix, dtype=np.float64)
    vectors = np.empty((R.size // 9, 3))
    rotation_vectors(np.ascontiguousarray(R).reshape(-1, 3, 3), vectors)
    return vectors.reshape(R.shape[:-1])


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
