"""What is in the messages that ROS 2 nodes receive."""

import cv2
import numpy as np
import pytest
from ros_listener import ABSOLUTE, decoded, everything_received, pixels
from ros_rig import BETA, LENS, SHAPE, START, made_frame

from drivers.messages import RIG_FROM_STAGE
from service.messages.viewing import fused_points
from solver.geometry.points import depth_from_distance


@pytest.fixture(scope="module")
def received(tmp_path_factory):
    return everything_received(tmp_path_factory.mktemp("ros"))


def test_frames_are_depth_with_the_optics_beside_them(received):
    samples, _, _ = received
    message, frame = decoded(samples, "camera/depth/image_raw"), made_frame()
    assert message.encoding == "32FC1"
    assert (message.header.frame_id, message.is_bigendian) == ("camera_optical_frame", 0)
    stamp = message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == frame.timestamp == START
    K, lens = LENS.intrinsics.matrix, np.array(LENS.distortion)
    np.testing.assert_allclose(pixels(message), depth_from_distance(frame.distance, K, lens), rtol=1e-6)
    assert np.isnan(pixels(message)[1, 1])
    info = decoded(samples, "camera/depth/camera_info")
    assert (info.header.stamp, info.header.frame_id) == (stamp, message.header.frame_id)
    assert (info.height, info.width, info.distortion_model) == (*SHAPE, "plumb_bob")
    np.testing.assert_array_equal(info.k.reshape(3, 3), K)
    np.testing.assert_array_equal(info.d, lens)
    np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], K)
    amplitude = decoded(samples, "camera/amplitude/image_raw")
    assert amplitude.encoding == "mono16"
    np.testing.assert_array_equal(pixels(amplitude), frame.amplitude)


def test_maps_are_rectified_by_the_nearest_sample(received):
    samples, told, _ = received
    result = told[2].map
    message = decoded(samples, "fused/depth/image_rect")
    shown = pixels(message)
    assert shown.shape == (BETA * SHAPE[0], BETA * SHAPE[1])
    assert message.header.frame_id == "fused"
    known = shown[np.isfinite(shown)]
    assert set(known.tolist()) <= set(result.depth[np.isfinite(result.depth)].tolist())  # nothing is mixed
    info = decoded(samples, "fused/depth/camera_info")
    assert not info.d.any()
    # A pixel's ray by the pinhole of camera_info meets the surface that the distorted map has on that ray.
    K = info.k.reshape(3, 3)
    row, column = 20, 30
    ray = np.array([[(column - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1], 1.0]])
    lens = np.array(LENS.distortion)
    place = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), result.intrinsics, lens)[0].ravel()
    assert np.hypot(*(place - (column, row))) > 3
    assert shown[row, column] == result.depth[round(place[1]), round(place[0])]
    deviation = pixels(decoded(samples, "fused/deviation/image_rect"))
    assert (deviation[np.isfinite(shown)] > 0).all()
    assert pixels(decoded(samples, "fused/amplitude/image_rect")).shape == shown.shape


def test_points_are_packed_in_their_order(received):
    samples, told, _ = received
    cloud, result = decoded(samples, "fused/points"), told[2].map
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        (name, 4 * place, 7, 1) for place, name in enumerate(("x", "y", "z", "intensity", "deviation"))
    ]
    assert (cloud.point_step, cloud.row_step, cloud.height) == (20, 20 * cloud.width, 1)
    np.testing.assert_array_equal(cloud.data.view("<f4").reshape(-1, 5), fused_points(result))
    assert cloud.header.frame_id == "fused"


def test_transforms_follow_rep_103(received):
    from scipy.spatial.transform import Rotation

    from drivers.poses import camera_centre, camera_rotation

    samples, _, _ = received
    found = {}
    for topic in ("/tf", "/tf_static"):
        for index in range(len(samples[topic])):
            for link in decoded(samples, topic, index).transforms:
                found[link.header.frame_id, link.child_frame_id] = link.transform
    assert set(found) == {
        ("rig", "camera_link"),
        ("camera_link", "camera_optical_frame"),
        ("rig", "fused"),
    }

    def turn(name):
        q = found[name].rotation
        return Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()

    frame = made_frame()
    truth = RIG_FROM_STAGE @ camera_rotation(frame.pan, frame.tilt, LENS.mount)
    chain = turn(("rig", "camera_link")) @ turn(("camera_link", "camera_optical_frame"))
    np.testing.assert_allclose(chain, truth, atol=1e-9)
    np.testing.assert_allclose(turn(("rig", "fused")), truth, atol=1e-9)
    # camera_link looks along its x: to the left for pan > 0, down for tilt < 0.
    x, y, z = turn(("rig", "camera_link"))[:, 0]
    assert x > 0.9
    assert y > 0
    assert z < 0
    place = found["rig", "camera_link"].translation
    centre = RIG_FROM_STAGE @ camera_centre(frame.pan, frame.tilt, LENS.mount)
    np.testing.assert_allclose([place.x, place.y, place.z], centre, atol=1e-12)


def test_diagnostics_tell_the_state(received):
    samples, _, _ = received
    (status,) = decoded(samples, "/diagnostics").status
    assert (status.level, status.name) == (0, "lidarboost: rig")
    assert {value.key: value.value for value in status.values}["state"] == "scanning"


@pytest.mark.slow
def test_bytes_are_read_by_another_implementation_of_cdr(received):
    from ros2_pyterfaces.cydr.all_msgs import CameraInfo, DiagnosticArray, Image, PointCloud2

    samples, _, _ = received
    kinds = {
        "Image": Image,
        "CameraInfo": CameraInfo,
        "PointCloud2": PointCloud2,
        "DiagnosticArray": DiagnosticArray,
    }
    for name, topic in ABSOLUTE.items():
        kind = kinds.get(topic.kind.rpartition("/")[2])
        if kind is None:
            continue
        message = kind.deserialize(samples[name][-1].payload.to_bytes())
        if kind is Image:
            theirs = np.asarray(message.data).view(np.uint8)
            np.testing.assert_array_equal(theirs, decoded(samples, topic.name).data)
