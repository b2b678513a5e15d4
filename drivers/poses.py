"""Where a turned camera looks: stage angles to rotations and transforms.

Stage axes at (0, 0): x right, y down, z forward. Pan > 0 turns left about the upward axis (−y) and is the
outer axis; tilt > 0 turns up about x.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.calibration import Mount

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def _rotation(vector: ArrayLike) -> Rotation:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(np.asarray(vector, dtype=np.float64))


def stage_rotation(pan: float, tilt: float) -> NDArray[np.float64]:
    """(3, 3) rotation that takes the turned platform's axes to the stage's at rest."""
    turn = _rotation((0.0, -pan, 0.0)) * _rotation((tilt, 0.0, 0.0))
    return np.asarray(turn.as_matrix())


def camera_rotation(pan: float, tilt: float, mount: Mount) -> NDArray[np.float64]:
    """(3, 3) rotation that takes camera axes to stage axes at the given angles (radians)."""
    return stage_rotation(pan, tilt) @ _rotation(mount.rotation).as_matrix()


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
    from scipy.spatial.transform import Rotation

    matrices = np.stack(
        [camera_rotation(pan, tilt, mount) for pan, tilt in np.asarray(angles, dtype=np.float64)]
    )
    return np.asarray(Rotation.from_matrix(matrices[0].T @ matrices).as_rotvec())
