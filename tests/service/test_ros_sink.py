"""How the service appears to ROS 2 nodes, by a client that is not ours (`pyzeros`)."""

import asyncio
import struct
import time

import numpy as np
import pytest
import zenoh.ext
from ros_listener import ABSOLUTE, HASHES, everything_received, listened
from ros_rig import LENS, START, client, events, made_frame, made_map, ros_rig

from service.messages.ros.types import RosTypes
from service.wire.ros.names import dds_type


@pytest.fixture(scope="module")
def received(tmp_path_factory):
    return everything_received(tmp_path_factory.mktemp("ros"))


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
