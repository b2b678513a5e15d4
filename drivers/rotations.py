"""Rotation vectors, matrices and quaternions.

SciPy has them too, but importing `scipy.spatial` takes longer than most commands to run.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]


def rotation_matrix(vector: ArrayLike) -> Float:
    """Rodrigues' formula: matrices (..., 3, 3) of rotation vectors (..., 3), radians."""
    turn = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    cross = np.zeros((*turn.shape, 3))
    cross[..., (2, 0, 1), (1, 2, 0)] = turn
    cross -= np.swapaxes(cross, -1, -2)
    # sinc(a/π) = sin(a)/a; (1 − cos a)/a² = ½ (sin(a/2)/(a/2))², which does not cancel where a is small.
    matrix: Float = (
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    )
    return matrix


def quaternion(matrix: ArrayLike) -> Float:
    """Unit quaternions (..., 4), x, y, z, w with w ≥ 0, of matrices (..., 3, 3).

    Every row of the symmetric matrix built here is the quaternion times four times one of its components; the
    row of the largest is taken. Source: Shepperd, "Quaternion from rotation matrix", 1978.
    """
    R = np.asarray(matrix, dtype=np.float64)
    products = np.empty((*R.shape[:-2], 4, 4))
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    trace = diagonal.sum(axis=-1)
    products[..., :3, :3] = R + np.swapaxes(R, -1, -2)
    products[..., (0, 1, 2), (0, 1, 2)] = 1 - trace[..., None] + 2 * diagonal
    around = R[..., (2, 0, 1), (1, 2, 0)] - R[..., (1, 2, 0), (2, 0, 1)]
    products[..., 3, :3] = products[..., :3, 3] = around
    products[..., 3, 3] = 1 + trace
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    row = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    row /= np.linalg.norm(row, axis=-1, keepdims=True)
    whole: Float = np.where(row[..., 3:] < 0, -row, row)
    return whole


def rotation_vector(matrix: ArrayLike) -> Float:
    """Rotation vectors (..., 3), radians, of matrices (..., 3, 3); at most half a turn."""
    q = quaternion(matrix)
    axis, cosine = q[..., :3], q[..., 3]
    sine = np.linalg.norm(axis, axis=-1)
    angle = 2 * np.arctan2(sine, cosine)
    scale = np.divide(angle, sine, out=np.full_like(angle, 2.0), where=sine > 0)
    vector: Float = scale[..., None] * axis
    return vector
