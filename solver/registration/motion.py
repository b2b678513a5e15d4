"""How a frame may move: one displacement, or a rotation of a calibrated camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.geometry.lens import camera_matrix, lens_coefficients, pixel_rays, tilt_matrix
from solver.geometry.positions import rotation_matrix, rotation_vector
from solver.kernels.rotation import aim, displace
from solver.registration.point_samples import Points
from solver.registration.samples import Samples
from solver.runtime import team

Float = NDArray[np.float64]
Image = NDArray[np.float32]


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
        displace(points.row, points.column, points.first, moves, row, column)
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
class Rotation:
    """Rotation vectors (N, 3) of a calibrated camera."""

    intrinsics: Float
    lens: Float
    rotational: bool = True

    @classmethod
    def of(cls, intrinsics: object, distortion: object) -> "Rotation":
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
        rays = points.row, points.column, points.first
        optics = (
            self.lens.astype(np.float32),
            tilt_matrix(self.lens).astype(np.float32),
            bool(self.lens.any()),
        )
        camera = self.camera(points.level).astype(np.float32)
        team.hand_out(len(row), aim, *rays, matrices, *optics, camera, row, column)
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


Motion = Shift | Rotation
