"""Where camera and map are: tf2_msgs/TFMessage, after REP 103 and REP 105.

`rig` stands still (x forward, y left, z up); `camera_link` turns with the camera, its axes likewise;
`camera_optical_frame` has x right, y down, z forward, and so has `fused`, the camera as it stood for a map.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Mount
from drivers.messages import RIG_FRAME_ID, RIG_FROM_STAGE
from drivers.poses import camera_centre, camera_rotation
from drivers.rotations import quaternion
from service.messages.ros.topics import TF, TF_STATIC, TRANSFORMS
from service.messages.ros.types import RosMessage, RosTypes

LINK, OPTICAL, FUSED = "camera_link", "camera_optical_frame", "fused"


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a frame is in another: metres, and a unit quaternion x, y, z, w."""

    translation: tuple[float, ...]
    rotation: tuple[float, ...]


def camera_transform(types: RosTypes, pan: float, tilt: float, mount: Mount, timestamp: int) -> RosMessage:
    """`rig` to `camera_link` at stage angles (radians)."""
    return _message(types, TF, RIG_FRAME_ID, LINK, _camera_in_rig(pan, tilt, mount, optical=False), timestamp)


def fused_transform(types: RosTypes, pan: float, tilt: float, mount: Mount, timestamp: int) -> RosMessage:
    """`rig` to `fused`, the optical axes of the reference frame."""
    return _message(types, TF, RIG_FRAME_ID, FUSED, _camera_in_rig(pan, tilt, mount, optical=True), timestamp)


def optical_transform(types: RosTypes, timestamp: int) -> RosMessage:
    """`camera_link` to `camera_optical_frame`, which never changes (REP 103)."""
    return _message(types, TF_STATIC, LINK, OPTICAL, _place(RIG_FROM_STAGE, np.zeros(3)), timestamp)


@lru_cache(maxsize=16)
def _camera_in_rig(pan: float, tilt: float, mount: Mount, *, optical: bool) -> _Place:
    """The projection centre, with the optical axes or with the rig's turned likewise."""
    rotation = RIG_FROM_STAGE @ camera_rotation(pan, tilt, mount)
    centre = RIG_FROM_STAGE @ camera_centre(pan, tilt, mount)
    return _place(rotation if optical else rotation @ RIG_FROM_STAGE.T, centre)


def _place(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> _Place:
    return _Place(tuple(translation.tolist()), tuple(quaternion(rotation).tolist()))


def _message(
    types: RosTypes, topic: str, parent: str, child: str, place: _Place, timestamp: int
) -> RosMessage:
    x, y, z = place.translation
    qx, qy, qz, qw = place.rotation
    transform = types.make(
        "geometry_msgs/msg/Transform",
        translation=types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        rotation=types.make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )
    stamped = types.make(
        "geometry_msgs/msg/TransformStamped",
        header=types.header(timestamp, parent),
        child_frame_id=child,
        transform=transform,
    )
    return RosMessage(topic, types.cdr(TRANSFORMS, types.make(TRANSFORMS, transforms=[stamped])))
