"""Rotations of the camera, and where they take its rays."""

import numpy as np
from numba import njit

from solver.kernels.barrier import take
from solver.kernels.distortion import distort

NOWHERE = np.float32(-1e9)  # position of a pixel whose ray leaves the camera's half-space


@njit(cache=True)
def rotation_matrices(vectors, matrices):  # type: ignore[no-untyped-def]
    """matrices ← those of rotation vectors, by Rodrigues' formula.

    Args:
        vectors: (n, 3), radians.
        matrices: (n, 3, 3).
    """
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


@njit(cache=True)
def rotation_vectors(matrices, vectors):  # type: ignore[no-untyped-def]
    """vectors ← those of rotation matrices, of less than half a turn.

    Args:
        matrices: (n, 3, 3).
        vectors: (n, 3), radians.
    """
    for k in range(len(matrices)):
        R = matrices[k]
        x, y, z = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
        sine = np.sqrt(x * x + y * y + z * z)
        angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1))
        scale = angle / sine if sine > 1e-12 else 1.0
        vectors[k, 0], vectors[k, 1], vectors[k, 2] = scale * x, scale * y, scale * z


@njit(cache=True, nogil=True)
def project(rank, size, rays, matrices, K, lens, tilt, distorted, positions):  # type: ignore[no-untyped-def]
    """positions ← where each pixel of each frame looks, NaN where its ray leaves the half-space; by a team.

    Args:
        rays: (H, W, 2), x and y of the rays at z = 1.
        matrices: (N, 3, 3), that take them to frame 0.
        K: (3, 3), camera matrix, pixels.
        lens: (14,), OpenCV's coefficients.
        tilt: (3, 3), of the lens's tilt.
        distorted: whether the lens distorts.
        positions: (N, H, W, 2), row and column, pixels.
    """
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


@njit(cache=True, fastmath=True)
def displace(rows, columns, first, moves, row, column):  # type: ignore[no-untyped-def]
    """row, column ← places of samples after the displacement of their frame.

    Args:
        rows: (samples,), pixels.
        columns: (samples,), pixels.
        first: (N + 1,), where the samples of each frame begin.
        moves: (N, 2), pixels.
        row: (samples,), pixels.
        column: (samples,), pixels.
    """
    for k in range(len(moves)):
        part = slice(first[k], first[k + 1])
        row[part] = rows[part] + moves[k, 0]
        column[part] = columns[part] + moves[k, 1]


@njit(cache=True, nogil=True)
def aim(counter, rays_y, rays_x, first, matrices, lens, tilt, distorted, camera, row, column):  # type: ignore[no-untyped-def]
    """row, column ← places of samples after the rotation of their frame; by a team.

    Args:
        counter: (1,), see `kernels.barrier`.
        rays_y: (samples,), at z = 1.
        rays_x: (samples,), at z = 1.
        first: (N + 1,), where the samples of each frame begin.
        matrices: (N, 3, 3).
        lens: (14,), OpenCV's coefficients.
        tilt: (3, 3), of the lens's tilt.
        distorted: whether the lens distorts.
        camera: (4,), focal lengths and centre in pixels, by row and by column.
        row: (samples,), pixels, far outside where a ray leaves the half-space.
        column: (samples,), pixels.
    """
    k = take(counter)
    while k < len(matrices):
        part = slice(first[k], first[k + 1])
        y, x = row[part], column[part]
        _rotate(rays_y[part], rays_x[part], matrices[k], y, x)
        if distorted:
            _bend(y, x, lens, tilt)
        _to_pixels(y, x, camera)
        k = take(counter)


@njit(cache=True, fastmath=True, error_model="numpy")
def _rotate(b, a, R, v, u):  # type: ignore[no-untyped-def]
    """v, u ← rays (b, a) after a rotation, y and x at z = 1, NOWHERE where they leave the half-space."""
    for s in range(len(a)):
        z = R[2, 0] * a[s] + R[2, 1] * b[s] + R[2, 2]
        ahead = z > np.float32(0.0)
        u[s] = (R[0, 0] * a[s] + R[0, 1] * b[s] + R[0, 2]) / z if ahead else NOWHERE
        v[s] = (R[1, 0] * a[s] + R[1, 1] * b[s] + R[1, 2]) / z if ahead else NOWHERE


@njit(cache=True, error_model="numpy")
def _bend(y, x, lens, tilt):  # type: ignore[no-untyped-def]
    """Rays as the lens images them, in place."""
    for s in range(len(x)):
        if x[s] == NOWHERE:
            continue
        u, v = distort(x[s], y[s], lens)[:2]
        w = tilt[2, 0] * u + tilt[2, 1] * v + tilt[2, 2]
        x[s] = (tilt[0, 0] * u + tilt[0, 1] * v + tilt[0, 2]) / w
        y[s] = (tilt[1, 0] * u + tilt[1, 1] * v + tilt[1, 2]) / w


@njit(cache=True, fastmath=True)
def _to_pixels(y, x, camera):  # type: ignore[no-untyped-def]
    """Rays to pixels, in place."""
    for s in range(len(x)):
        y[s] = y[s] * camera[0] + camera[2]
        x[s] = x[s] * camera[1] + camera[3]
