"""What viewers are given of a map: where it belongs, millimetres, and points."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from scipy.spatial.transform import Rotation

from drivers.calibration import Mount
from drivers.messages import decode_image, frame_messages
from drivers.poses import camera_centre, camera_rotation
from service.messages.encoding import fused_messages
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.messages.viewing import Extras, depth_mm_message, fused_points, points_message
from solver.geometry.lens import pixel_rays
from solver.geometry.points import depth_from_distance, distance_from_depth

LENS = (-0.35, 0.12, 0.001, -0.002)


@pytest.fixture
def shown(fused: Callable[[int], FusedMap]) -> FusedMap:
    """A map that was taken with the camera turned, on a stage with a lever arm."""
    result = fused(1)
    mount = Mount(lever_arm=(0.02, -0.03, 0.1))
    return replace(
        result,
        frame=replace(result.frame, pan=0.2, tilt=-0.1),
        calibration=result.calibration.model_copy(update={"mount": mount}),
    )


def bent(result: FusedMap) -> FusedMap:
    """The same distances seen through a lens that distorts."""
    calibration = result.calibration.model_copy(update={"distortion": LENS})
    depth = depth_from_distance(result.distance, result.intrinsics, LENS)
    return replace(result, calibration=calibration, depth=depth)


def test_a_map_has_a_frame_of_its_own_where_its_reference_frame_looked(shown: FusedMap) -> None:
    messages = {message.topic: message for message in fused_messages(shown)}
    placed = FrameTransform.FromString(messages["fused/transform"].payload)
    assert (placed.parent_frame_id, placed.child_frame_id) == ("rig", "fused")
    assert placed.timestamp.ToNanoseconds() == shown.frame.timestamp
    mount = shown.calibration.mount
    turn = placed.rotation
    axes = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    to_stage = np.array([[0, -1.0, 0], [0, 0, -1.0], [1.0, 0, 0]])
    np.testing.assert_allclose(to_stage @ axes, camera_rotation(0.2, -0.1, mount), atol=1e-9)
    at = to_stage @ [placed.translation.x, placed.translation.y, placed.translation.z]
    np.testing.assert_allclose(at, camera_centre(0.2, -0.1, mount), atol=1e-9)
    assert CameraCalibration.FromString(messages["fused/calibration"].payload).frame_id == "fused"
    of_frame = {message.topic: message for message in frame_messages(shown.frame, mount)}
    moved = FrameTransform.FromString(of_frame["stage/transform"].payload)
    assert (moved.child_frame_id, moved.rotation) == ("camera", placed.rotation)


def test_millimetres_are_those_of_the_depth(shown: FusedMap) -> None:
    image = decode_image(depth_mm_message(shown).payload)
    known = np.isfinite(shown.depth)
    assert image.dtype == np.uint16
    assert (image[~known] == 0).all()
    np.testing.assert_allclose(image[known] / 1000, shown.depth[known], atol=5.1e-4)
    far = replace(shown, depth=shown.depth + 64)
    assert (decode_image(depth_mm_message(far).payload) == 0).sum() > (image == 0).sum()


def test_millimetres_have_the_distortion_taken_out(shown: FusedMap) -> None:
    """A slanted wall seen through the lens lies on its plane when K alone is used."""
    result = bent(shown)
    K = result.intrinsics
    rows, columns = np.indices(result.depth.shape)
    x, y = (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]
    flat = 2.0 / (1 + 0.4 * x + 0.2 * y)
    rays = pixel_rays(result.depth.shape, K, LENS)
    slanted = (2.0 / (1 + 0.4 * rays[..., 0] + 0.2 * rays[..., 1])).astype(np.float32)
    seen = replace(result, depth=slanted, distance=distance_from_depth(slanted, K, LENS))
    image = decode_image(depth_mm_message(seen).payload).astype(float) / 1000
    known = image > 0
    assert known.mean() > 0.8
    assert np.abs((image - flat)[known]).max() < 2.0 * 0.5 / K[0, 0] * 0.7 + 1e-3  # half a pixel of the slant
    cloud = fused_points(seen)
    off = cloud[:, 2] + 0.4 * cloud[:, 0] + 0.2 * cloud[:, 1] - 2.0
    assert np.abs(off).max() < 1e-5


@pytest.mark.parametrize("lens", [(), LENS])
def test_thinned_points_are_some_of_all(shown: FusedMap, lens: tuple[float, ...]) -> None:
    result = bent(shown) if lens else shown
    all_of_them = {tuple(np.round(point[:3], 4)) for point in fused_points(result).tolist()}
    some = fused_points(result, 4)
    assert {tuple(np.round(point[:3], 4)) for point in some.tolist()} <= all_of_them
    assert len(some) == np.isfinite(result.distance[2::4, 2::4]).sum()


def test_extras_are_made_once_and_only_where_asked_for(shown: FusedMap) -> None:
    event = MapFused(shown, None)
    assert Extras().of(event) == ()
    found = Extras(points=4, depth_mm=True).of(event)
    assert [message.topic for message in found] == ["fused/points", "fused/depth_mm"]
    assert Extras(points=4, depth_mm=True).of(event) is found
    cloud = PointCloud.FromString(found[0].payload)
    assert cloud.frame_id == "fused"
    assert len(cloud.data) < len(PointCloud.FromString(points_message(shown).payload).data) / 15
