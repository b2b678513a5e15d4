"""Where a turned camera looks: stage angles to rotations and transforms.

Stage axes at (0, 0): x right, y down, z forward. Pan > 0 turns left about the upward axis (−y) and is the
outer axis; tilt > 0 turns up about x.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.calibration import Mount
from drivers.rotations import rotation_matrix, rotation_vector


def stage_rotation(pan: ArrayLike, tilt: ArrayLike) -> NDArray[np.float64]:
    """Rotations (..., 3, 3) that take the turned platform's axes to the stage's at rest; angles (...)."""
    p, t = np.asarray(pan, dtype=np.float64), np.asarray(tilt, dtype=np.float64)
    still = np.zeros_like(p)
    return rotation_matrix(np.stack([still, -p, still], -1)) @ rotation_matrix(
        np.stack([t, still, still], -1)
    )


def camera_rotation(pan: ArrayLike, tilt: ArrayLike, mount: Mount) -> NDArray[np.float64]:
    """Rotations (..., 3, 3) that take camera axes to stage axes at the given angles (...), radians."""
    return stage_rotation(pan, tilt) @ rotation_matrix(mount.rotation)


def camera_centre(pan: float, tilt: float, mount: Mount) -> NDArray[np.float64]:
    """(3,) projection centre in stage axes, metres."""
    centre: NDArray[np.float64] = stage_rotation(pan, tilt) @ np.asarray(mount.lever_arm)
    return centre


def relative_rotations(angles: ArrayLike, mount: Mount) -> NDArray[np.float64]:
    """Rotation vectors that take each frame's rays to frame 0's, as the solver expects them.

    Args:
        angles: (N, 2) pan and tilt of each frame, radians.
        mount: how the camera sits on the stage.

    Returns:
        (N, 3) radians, camera axes; the first is zero.
    """
    pan, tilt = np.asarray(angles, dtype=np.float64).T
    matrices = camera_rotation(pan, tilt, mount)
    return rotation_vector(matrices[0].T @ matrices)
