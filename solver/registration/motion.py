"""How a frame may move: one displacement, or a rotation of a calibrated camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.lens import camera_matrix, lens_coefficients
from solver.positions import rotated_positions, rotation_matrix, rotation_vector, sample_positions

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Shift:
    """Displacements; the parameters (N, 3) are (dy, dx, unused) in full-resolution pixels."""

    rotational: bool = False

    def positions(self, parameters: Float, shape: tuple[int, int], level: int) -> NDArray[np.float32]:
        """(N, H, W, 2) at a pyramid level, in that level's pixels."""
        return sample_positions((len(parameters), *shape), shifts=parameters[:, :2] / 2**level)

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

    def positions(self, parameters: Float, shape: tuple[int, int], level: int) -> NDArray[np.float32]:
        """(N, H, W, 2) at a pyramid level, in that level's pixels."""
        return rotated_positions(parameters, shape, self._at(level), self.lens)

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
