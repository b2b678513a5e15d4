"""How a frame may move: one displacement, or a rotation of a calibrated camera."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from solver.geometry.lens import camera_matrix, lens_coefficients, pixel_rays, tilt_matrix
from solver.geometry.positions import rotation_matrix, rotation_vector
from solver.kernels.lens import distort
from solver.registration.points import Points
from solver.registration.samples import Samples

Float = NDArray[np.float64]
Image = NDArray[np.float32]

NOWHERE = np.float32(-1e9)  # position of a pixel whose ray leaves the camera's half-space


@dataclass(frozen=True, slots=True)
class Shift:
    """Displacements; the parameters (N, 3) are (dy, dx, unused) in full-resolution pixels."""

    rotational: bool = False

    def base(self, samples: Samples) -> Image:
        """Row and column of every pixel, (2, H, W)."""
        return np.indices(samples.shape, dtype=np.float32)

    def place(self, points: Points, parameters: Float) -> tuple[Image, Image]:
        """Rows and columns (P,) at which points look, in pixels of their level."""
        row, column = np.empty_like(points.row), np.empty_like(points.row)
        moves = (parameters[:, :2] / 2**points.level).astype(np.float32)
        _shift(points.row, points.column, points.first, moves, row, column)
        return row, column

    def camera(self, level: int) -> Float:
        """fy, fx, cy, cx for the derivatives: one parameter unit is one full-resolution pixel."""
        return np.array([0.5**level, 0.5**level, 0.0, 0.0])

    def moved(self, parameters: Float, steps: Float) -> Float:
        """Parameters after Gauss–Newton steps."""
        return parameters + steps

    def relative(self, parameters: Float, reference: int) -> Float:
        """Parameters with the frame `reference` at rest."""
        relative: Float = parameters - parameters[reference]
        return relative

    def unit(self) -> Float:
        """Size of each parameter that moves the image by about one pixel."""
        return np.ones(3)


@dataclass(frozen=True, slots=True)
class Turn:
    """Rotation vectors (N, 3) of a calibrated camera."""

    intrinsics: Float
    lens: Float
    rotational: bool = True

    @classmethod
    def of(cls, intrinsics: object, distortion: object) -> "Turn":
        """Check the calibration."""
        return cls(camera_matrix(intrinsics), lens_coefficients(distortion))  # type: ignore[arg-type]

    def _at(self, level: int) -> Float:
        K = self.intrinsics.copy()
        K[:2, 2] = (K[:2, 2] + 0.5) / 2**level - 0.5
        K[0, 0] /= 2**level
        K[1, 1] /= 2**level
        return K

    def base(self, samples: Samples) -> Image:
        """The ray (y, x) at z = 1 through every pixel, (2, H, W)."""
        rays = pixel_rays(samples.shape, self._at(samples.level), self.lens)
        return np.ascontiguousarray(np.moveaxis(rays, -1, 0)[::-1], dtype=np.float32)

    def place(self, points: Points, parameters: Float) -> tuple[Image, Image]:
        """Rows and columns (P,) at which points look, in pixels of their level."""
        row, column = np.empty_like(points.row), np.empty_like(points.row)
        matrices = rotation_matrix(parameters).astype(np.float32)
        camera = self.camera(points.level).astype(np.float32)
        _turn(points.row, points.column, points.first, matrices, row, column)
        if self.lens.any():
            _bend(row, column, self.lens.astype(np.float32), tilt_matrix(self.lens).astype(np.float32))
        _project(row, column, camera)
        return row, column

    def camera(self, level: int) -> Float:
        """fy, fx, cy, cx for the derivatives; the lens is left out there, which costs only speed."""
        K = self._at(level)
        return np.array([K[1, 1], K[0, 0], K[1, 2], K[0, 2]])

    def moved(self, parameters: Float, steps: Float) -> Float:
        """Parameters after Gauss–Newton steps, which turn on top of the present rotation."""
        return rotation_vector(rotation_matrix(steps) @ rotation_matrix(parameters))

    def relative(self, parameters: Float, reference: int) -> Float:
        """Parameters with the frame `reference` at rest."""
        back = rotation_matrix(parameters[reference]).T
        return rotation_vector(back @ rotation_matrix(parameters))

    def unit(self) -> Float:
        """Size of each parameter that moves the image by about one pixel."""
        focal = float(np.sqrt(self.intrinsics[0, 0] * self.intrinsics[1, 1]))
        return np.array([1 / focal, 1 / focal, 4 / focal])  # roll moves a pixel by its distance to the centre


Motion = Shift | Turn


@numba.njit(cache=True, fastmath=True)
def _shift(rows, columns, first, moves, row, column):  # type: ignore[no-untyped-def]
    for k in range(len(moves)):
        part = slice(first[k], first[k + 1])
        row[part] = rows[part] + moves[k, 0]
        column[part] = columns[part] + moves[k, 1]


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def _turn(rays_y, rays_x, first, matrices, y, x):  # type: ignore[no-untyped-def]
    """Rays (y, x) at z = 1 after each frame's rotation."""
    for k in range(len(matrices)):
        R = matrices[k]
        a, b = rays_x[first[k] : first[k + 1]], rays_y[first[k] : first[k + 1]]
        u, v = x[first[k] : first[k + 1]], y[first[k] : first[k + 1]]
        for s in range(len(a)):
            z = R[2, 0] * a[s] + R[2, 1] * b[s] + R[2, 2]
            ahead = z > np.float32(0.0)
            u[s] = (R[0, 0] * a[s] + R[0, 1] * b[s] + R[0, 2]) / z if ahead else NOWHERE
            v[s] = (R[1, 0] * a[s] + R[1, 1] * b[s] + R[1, 2]) / z if ahead else NOWHERE


@numba.njit(cache=True, error_model="numpy")
def _bend(y, x, lens, tilt):  # type: ignore[no-untyped-def]
    """Rays as the lens images them."""
    for s in range(len(x)):
        if x[s] == NOWHERE:
            continue
        u, v = distort(x[s], y[s], lens)[:2]
        w = tilt[2, 0] * u + tilt[2, 1] * v + tilt[2, 2]
        x[s] = (tilt[0, 0] * u + tilt[0, 1] * v + tilt[0, 2]) / w
        y[s] = (tilt[1, 0] * u + tilt[1, 1] * v + tilt[1, 2]) / w


@numba.njit(cache=True, fastmath=True)
def _project(y, x, camera):  # type: ignore[no-untyped-def]
    for s in range(len(x)):
        y[s] = y[s] * camera[0] + camera[2]
        x[s] = x[s] * camera[1] + camera[3]
