"""What ROS 2 nodes receive of the service, by a client that is not ours (`pyzeros`)."""

import asyncio
import struct
import time

import cv2
import numpy as np
import pytest
import zenoh.ext
from ros_rig import BETA, LENS, SHAPE, START, client, events, made_frame, made_map, ros_rig

from drivers.messages import RIG_FROM_STAGE
from service.messages.ros.topics import ROS_TOPICS
from service.messages.ros.types import RosTypes
from service.messages.viewing import fused_points
from service.wire.ros.names import dds_type
from solver.geometry import depth_from_distance

pyzeros = pytest.importorskip("pyzeros", reason="needs pyzeros")

HASHES = {
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}
"""As the official message packages have them; of tf2_msgs and diagnostic_msgs as rosbags computes them."""

ABSOLUTE = {topic.full("/lidarboost"): topic for topic in ROS_TOPICS.values()}


def stand_in(kind):
    """A message type for a subscriber that wants bytes alone."""
    return type("Kind", (), {"get_type_name": lambda: kind, "hash_rihs01": lambda: f"RIHS01_{HASHES[kind]}"})


async def listened(endpoint, do, enough, domain=0, timeout=30):
    """Samples by absolute topic that a pyzeros node receives while `do` runs, until `enough` of them."""
    from pyzeros.sub import RawSub

    session, got = client(endpoint), {}
    node = pyzeros.Node("independent", session=session, domain_id=domain)
    subscriptions = [
        RawSub(
            stand_in(topic.kind),
            name,
            lambda sample, name=name: got.setdefault(name, []).append(sample),
            session=node,
        )
        for name, topic in ABSOLUTE.items()
    ]
    try:
        deadline = time.monotonic() + timeout
        while not enough(got) and time.monotonic() < deadline:
            await asyncio.to_thread(do)
            await asyncio.sleep(0.1)
    finally:
        for subscription in subscriptions:
            subscription.close()
        node.close()
        session.close()
    return got


@pytest.fixture(scope="module")
def received(tmp_path_factory):
    """Everything, of one burst."""
    told = events()
    with ros_rig(tmp_path_factory.mktemp("ros")) as (endpoint, sink):

        def do():
            for event in told:
                sink.take(event)

        samples = asyncio.run(listened(endpoint, do, lambda got: len(got) == len(ABSOLUTE)))
        tokens = graph(endpoint)
    return samples, told, tokens


def graph(endpoint):
    with client(endpoint) as session:
        return [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**", timeout=3)]


def decoded(samples, topic, index=-1):
    """By rosbags; images also as (H, W)."""
    name = ROS_TOPICS[topic].full("/lidarboost")
    return RosTypes()._store.deserialize_cdr(samples[name][index].payload.to_bytes(), ROS_TOPICS[topic].kind)


def pixels(message):
    kind = {"32FC1": "<f4", "mono16": "<u2"}[message.encoding]
    assert message.step == message.width * np.dtype(kind).itemsize
    return message.data.view(kind).reshape(message.height, message.width)


def test_every_topic_arrives_and_no_other(received):
    samples, _, tokens = received
    assert set(samples) == set(ABSOLUTE)
    published = {token.split("/")[9].replace("%", "/") for token in tokens if "/MP/" in token}
    assert published == set(ABSOLUTE)
    assert sum("/NN/" in token and token.endswith("/%lidarboost/lidarboost") for token in tokens) == 1


def test_hashes_are_those_of_the_official_packages():
    for distribution in ("iron", "jazzy", "kilted", "lyrical"):
        types = RosTypes(distribution)
        assert {kind: types.hash(kind) for kind in HASHES} == {k: f"RIHS01_{h}" for k, h in HASHES.items()}
    assert RosTypes("humble").hash("sensor_msgs/msg/Image") == "TypeHashNotSupported"


def test_messages_carry_number_time_and_the_publishers_id(received):
    from pyzeros.utils import rmw_zenoh_gid

    samples, _, tokens = received
    for name, topic in ABSOLUTE.items():
        (token,) = [t for t in tokens if f"/{name.replace('/', '%')}/{dds_type(topic.kind)}/" in t]
        numbers = []
        for sample in samples[name]:
            number, at, size, who = struct.unpack("<qqB16s", sample.attachment.to_bytes())
            numbers.append(number)
            assert (size, who) == (16, rmw_zenoh_gid(token))
            assert abs(at - time.time_ns()) < 300e9
            assert str(sample.encoding) == "application/cdr"
        assert numbers == sorted(numbers)


def test_tokens_are_those_that_pyzeros_would_make(received):
    from pyzeros.pub import token_keyexpr
    from pyzeros.qos import QosProfile

    _, _, tokens = received
    made = [token for token in tokens if "/MP/" in token]
    for token in made:
        parts = token.split("/")
        name = parts[9].replace("%", "/")
        topic = ABSOLUTE[name]
        qos = {"durability": "transient_local", "depth": 1} if topic.latched else {"durability": "volatile"}
        expected = token_keyexpr(
            name=name,
            dds_type=dds_type(topic.kind),
            hash=f"RIHS01_{HASHES[topic.kind]}",
            qos_profile=QosProfile(reliability="reliable", **{"history": "keep_last", "depth": 10} | qos),
            node_name="lidarboost",
            namespace="/lidarboost",
            session=object(),  # not asked, for all ids are given
            domain_id=0,
            _zenoh_id=parts[2],
            _node_id=0,
            _entity_id=parts[4],
        )
        assert token == expected


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


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_who_comes_late_receives_what_is_latched(tmp_path, mode):
    got = {}
    with ros_rig(tmp_path, domain=3, namespace="bench/rig") as (endpoint, sink):
        for event in events():
            sink.take(event)
        with client(endpoint, mode) as session:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            for name, topic in ABSOLUTE.items():
                key = f"3{name}/{dds_type(topic.kind)}/RIHS01_{HASHES[topic.kind]}"
                zenoh.ext.declare_advanced_subscriber(
                    session, key, lambda sample, name=name: got.setdefault(name, sample), history=history
                )
            wanted = {name for name, topic in ABSOLUTE.items() if topic.latched}
            deadline = time.monotonic() + 20
            while not wanted <= set(got) and time.monotonic() < deadline:
                time.sleep(0.05)
    assert set(got) == wanted


def test_a_large_map_reaches_a_client_byte_for_byte(tmp_path):
    from drivers import sr3000_calibration
    from service.messages.events import DevicesOpened, MapFused

    lens = sr3000_calibration()
    result = made_map(lens)
    assert result.depth.shape == (576, 704)
    name = "/lidarboost/fused/depth/image_rect"
    with ros_rig(tmp_path) as (endpoint, sink):
        sink.take(DevicesOpened("SR3000", "device", lens, None, START))
        got = asyncio.run(
            listened(endpoint, lambda: sink.take(MapFused(result, None)), lambda got: name in got)
        )
    message = RosTypes()._store.deserialize_cdr(got[name][0].payload.to_bytes(), "sensor_msgs/msg/Image")
    assert message.data.tobytes() == result.depth.astype("<f4").tobytes()


def test_nothing_is_made_of_a_camera_without_amplitude(tmp_path):
    from service.messages.events import FrameCaptured

    with ros_rig(tmp_path) as (_, sink):
        sink.take(events()[0])
        told = [m.topic for m in sink._messages(FrameCaptured(made_frame(amplitude=False), LENS.mount))]
    assert told == ["/tf", "camera/depth/camera_info"]  # and nobody listens to the images


def test_a_camera_of_ours_sees_the_rig_as_a_depth_camera(tmp_path):
    import threading

    from drivers import make_camera
    from service.messages.events import FrameCaptured

    opened = events()[0]
    stop = threading.Event()
    with ros_rig(tmp_path) as (endpoint, sink):

        def run():
            sink.take(opened)
            number = 0
            while not stop.wait(0.02):
                sink.take(FrameCaptured(made_frame(number % 100), LENS.mount))
                number += 1

        thread = threading.Thread(target=run)
        thread.start()
        try:
            topics = {"depth": "lidarboost/camera/depth/image_raw", "kind": "depth"}
            options = {"source": "ros2", "endpoint": endpoint, "wait": 20.0} | topics
            options["amplitude"] = "lidarboost/camera/amplitude/image_raw"
            with make_camera("zenoh", options) as camera:
                camera.start()
                frame = camera.grab(10)
                known = camera.calibration
        finally:
            stop.set()
            thread.join()
    truth = made_frame()
    np.testing.assert_allclose(frame.distance, truth.distance, rtol=1e-5)
    np.testing.assert_array_equal(frame.amplitude, truth.amplitude)
    assert known.intrinsics == LENS.intrinsics
    assert known.distortion == LENS.distortion[:4]  # trailing zeros say nothing
