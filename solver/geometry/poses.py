"""Where the frames of a stream look: displacements, or rotations of a calibrated camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.geometry.positions import rotation_matrix, rotation_vector, sample_positions

Pose = NDArray[np.float64]
"""(2,): (dy, dx) in low-resolution pixels; or (3,): a rotation vector, radians."""


@dataclass(frozen=True, slots=True)
class PoseSpace:
    """Displacements without a camera matrix (3, 3), else rotations."""

    matrix: NDArray[np.float64] | None
    distortion: NDArray[np.float64] | None

    def origin(self) -> Pose:
        """The pose of the first frame."""
        return np.zeros(2 if self.matrix is None else 3)

    def relative(self, pose: Pose, base: Pose) -> Pose:
        """A pose as seen from another one."""
        if self.matrix is None:
            return pose - base
        return rotation_vector(rotation_matrix(base).T @ rotation_matrix(pose))

    def composed(self, base: Pose, moved: Pose) -> Pose:
        """The pose that is `moved` as seen from `base`."""
        if self.matrix is None:
            return base + moved
        return rotation_vector(rotation_matrix(base) @ rotation_matrix(moved))

    def positions(self, shape: tuple[int, ...], pose: Pose) -> NDArray[np.float32]:
        """(H, W, 2): where each pixel of a frame (H, W) looks on the grid of a frame at rest."""
        seen, size = pose[None], (1, shape[0], shape[1])
        if self.matrix is None:
            return np.asarray(sample_positions(size, shifts=seen)[0])
        turned = sample_positions(size, rotations=seen, intrinsics=self.matrix, distortion=self.distortion)
        return np.asarray(turned[0])


def overlap(positions: NDArray[np.float32]) -> float:
    """The share of a frame's pixels (H, W, 2) that look inside the grid."""
    inside = np.ones(positions.shape[:2], np.bool_)
    for axis, size in enumerate(positions.shape[:2]):
        inside &= (positions[..., axis] > -0.5) & (positions[..., axis] < size - 0.5)
    return np.count_nonzero(inside) / inside.size


def central(positions: NDArray[np.float32]) -> NDArray[np.float64]:
    """(dy, dx) at the image centre, the mean over the one to four pixels around it."""
    rows, columns = positions.shape[:2]
    window = positions[(rows - 1) // 2 : rows // 2 + 1, (columns - 1) // 2 : columns // 2 + 1]
    return np.asarray(window.mean(axis=(0, 1), dtype=np.float64) - [(rows - 1) / 2, (columns - 1) / 2])
