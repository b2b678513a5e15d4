"""Points of a map: sensor_msgs/PointCloud2."""

import numpy as np

from service.messages.map import FusedMap
from service.messages.ros.topics import FUSED_CLOUD, POINT_CLOUD
from service.messages.ros.transforms import FUSED
from service.messages.ros.types import RosMessage, RosTypes
from service.messages.viewing import fused_points

FIELDS = ("x", "y", "z", "intensity", "deviation")
_FLOAT32 = 7
"""sensor_msgs/PointField."""


def point_cloud(types: RosTypes, result: FusedMap) -> RosMessage:
    """Every known pixel, float32, packed and in this order, for some viewers mangle what is not."""
    points = np.ascontiguousarray(fused_points(result), dtype="<f4")
    step = points.itemsize * len(FIELDS)
    fields = [
        types.make(
            "sensor_msgs/msg/PointField",
            name=name,
            offset=place * points.itemsize,
            datatype=_FLOAT32,
            count=1,
        )
        for place, name in enumerate(FIELDS)
    ]
    message = types.make(
        POINT_CLOUD,
        header=types.header(result.frame.timestamp, FUSED),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * len(points),
        data=points.view(np.uint8).ravel(),
        is_dense=True,
    )
    return RosMessage(FUSED_CLOUD, types.cdr(POINT_CLOUD, message))
