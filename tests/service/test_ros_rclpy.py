"""Our bytes, read by ROS 2's own client library where its wheels are installed.

`ROS_PYTHON` names an interpreter that has them: pip install ros-rclpy ros-sensor-msgs
ros-rmw-fastrtps-cpp (Python 3.11).
"""

import base64
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ros_rig import LENS, START, made_map

from service.messages.ros.cloud import point_cloud
from service.messages.ros.images import camera_info, image
from service.messages.ros.types import RosTypes
from service.messages.viewing import fused_points

READ = """
import base64, hashlib, json, sys
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
told = json.load(sys.stdin)
found = {}
for name, kind in (("image", Image), ("info", CameraInfo), ("cloud", PointCloud2)):
    found[name] = deserialize_message(base64.b64decode(told[name]), kind)
image, info, cloud = found["image"], found["info"], found["cloud"]
print(json.dumps({
    "image": [image.height, image.width, image.encoding, image.step, image.header.frame_id],
    "stamp": [image.header.stamp.sec, image.header.stamp.nanosec],
    "pixels": hashlib.sha256(bytes(image.data)).hexdigest(),
    "k": list(info.k), "d": list(info.d), "p": list(info.p), "model": info.distortion_model,
    "fields": [[f.name, f.offset, f.datatype, f.count] for f in cloud.fields],
    "points": hashlib.sha256(bytes(cloud.data)).hexdigest(), "width": cloud.width,
}))
"""


@pytest.fixture(scope="module")
def ros():
    """How to start an interpreter that has rclpy."""
    python = os.environ.get("ROS_PYTHON", sys.executable)
    folder = Path(python).parents[1]
    surroundings = {
        **os.environ,
        "AMENT_PREFIX_PATH": str(folder),
        "LD_LIBRARY_PATH": str(folder / "lib"),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    known = subprocess.run(
        [python, "-c", "import rclpy, sensor_msgs.msg"], env=surroundings, capture_output=True
    )
    if known.returncode:
        pytest.skip("rclpy is not installed (ROS_PYTHON names an interpreter that has it)")
    return python, surroundings


@pytest.mark.slow
def test_the_client_library_of_ros_reads_images_optics_and_points(ros):
    import hashlib

    types, result = RosTypes(), made_map()
    depth = result.depth
    messages = {
        "image": image(types, "fused/depth/image_rect", depth, START, "fused"),
        "info": camera_info(types, "camera/depth/camera_info", LENS, START, "camera_optical_frame"),
        "cloud": point_cloud(types, result),
    }
    told = {name: base64.b64encode(message.payload).decode() for name, message in messages.items()}
    python, surroundings = ros
    done = subprocess.run(
        [python, "-c", READ],
        input=json.dumps(told),
        env=surroundings,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    found = json.loads(done.stdout)
    assert found["image"] == [*depth.shape, "32FC1", depth.shape[1] * 4, "fused"]
    assert found["stamp"] == list(divmod(START, 10**9))
    assert found["pixels"] == hashlib.sha256(depth.astype("<f4").tobytes()).hexdigest()
    np.testing.assert_array_equal(found["k"], LENS.intrinsics.matrix.ravel())
    assert (found["d"], found["model"]) == (list(LENS.distortion), "plumb_bob")
    assert [field[0] for field in found["fields"]] == ["x", "y", "z", "intensity", "deviation"]
    points = fused_points(result).astype("<f4")
    assert (found["width"], found["points"]) == (len(points), hashlib.sha256(points.tobytes()).hexdigest())
