"""Where camera and map are: tf2_msgs/TFMessage, after REP 103 and REP 105.

`rig` stands still (x forward, y left, z up); `camera_link` turns with the camera, its axes likewise;
`camera_optical_frame` has x right, y down, z forward, and so has `fused`, the camera as it stood for a map.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Mount
from drivers.messages import RIG_FRAME_ID, RIG_FROM_STAGE
from drivers.poses import camera_centre, camera_rotation
from service.messages.ros.topics import TF, TF_STATIC, TRANSFORMS
from service.messages.ros.types import RosMessage, RosTypes

LINK, OPTICAL, FUSED = "camera_link", "camera_optical_frame", "fused"


def camera_transform(types: RosTypes, pan: float, tilt: float, mount: Mount, timestamp: int) -> RosMessage:
    """`rig` to `camera_link` at stage angles (radians)."""
    rotation, place = _camera_in_rig(pan, tilt, mount)
    return _message(types, TF, [(RIG_FRAME_ID, LINK, rotation @ RIG_FROM_STAGE.T, place)], timestamp)


def fused_transform(types: RosTypes, pan: float, tilt: float, mount: Mount, timestamp: int) -> RosMessage:
    """`rig` to `fused`, the optical axes of the reference frame."""
    return _message(types, TF, [(RIG_FRAME_ID, FUSED, *_camera_in_rig(pan, tilt, mount))], timestamp)


def optical_transform(types: RosTypes, timestamp: int) -> RosMessage:
    """`camera_link` to `camera_optical_frame`, which never changes (REP 103)."""
    return _message(types, TF_STATIC, [(LINK, OPTICAL, RIG_FROM_STAGE, np.zeros(3))], timestamp)


def _camera_in_rig(pan: float, tilt: float, mount: Mount) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation that takes optical axes to the rig's, and the projection centre, metres."""
    rotation = RIG_FROM_STAGE @ camera_rotation(pan, tilt, mount)
    return rotation, RIG_FROM_STAGE @ camera_centre(pan, tilt, mount)


def _message(
    types: RosTypes,
    topic: str,
    links: Sequence[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]],
    timestamp: int,
) -> RosMessage:
    from scipy.spatial.transform import Rotation

    transforms = []
    for parent, child, rotation, place in links:
        turn = Rotation.from_matrix(rotation).as_quat().tolist()
        transform = types.make(
            "geometry_msgs/msg/Transform",
            translation=types.make(
                "geometry_msgs/msg/Vector3", **dict(zip("xyz", place.tolist(), strict=True))
            ),
            rotation=types.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True))),
        )
        header = types.header(timestamp, parent)
        transforms.append(
            types.make(
                "geometry_msgs/msg/TransformStamped",
                header=header,
                child_frame_id=child,
                transform=transform,
            )
        )
    return RosMessage(topic, types.cdr(TRANSFORMS, types.make(TRANSFORMS, transforms=transforms)))
