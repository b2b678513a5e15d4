"""Depth images that others publish: ROS 2 under rmw_zenoh, Foxglove, another rig."""

import time
from contextlib import suppress

import numpy as np
import pytest
from made_bags import SHAPE, K, Ros, amplitude_image, depth_image
from zenoh_source import zenoh_source

from drivers import DeviceLostError, DeviceTimeoutError, InitialisationError, NotAvailableError, make_camera

DEPTH, INFO, LIGHT = (f"camera/{name}" for name in ("depth/image_raw", "depth/camera_info", "ir/image_raw"))
HASH = "RIHS01_0123"


@pytest.fixture
def source():
    with zenoh_source() as made:
        yield made


def key_of(topic, kind, domain=0):
    package, _, name = kind.split("/")
    return f"{domain}/{topic}/{package}::msg::dds_::{name}_/{HASH}"


class Robot:
    """A ROS 2 node with a depth camera."""

    def __init__(self, source, domain=0):
        self.source, self.domain = source, domain

    def send(self, bag, latched=False):
        for one in bag.written:
            key = key_of(one.topic.strip("/"), one.kind, self.domain)
            payload = bytes(bag.store.serialize_cdr(one.message, one.kind))
            self.source.put(key, payload, "application/cdr", latched)

    def info(self, **changes):
        bag = Ros()
        bag.info(topic="/" + INFO, **changes)
        self.send(bag, latched=True)

    def images(self, stamp=time.time_ns, light=False, shape=SHAPE, change=lambda image: image):
        def publish(number):
            bag, at = Ros(), stamp()
            bag.image(change(depth_image(number % 100, shape)), at, "/" + DEPTH)
            if light:
                bag.image(amplitude_image(number % 100), at, "/" + LIGHT, "mono16")
            self.send(bag)

        keys = [key_of(topic, "sensor_msgs/msg/Image", self.domain) for topic in (DEPTH, LIGHT)[: 1 + light]]
        self.source.repeat(publish, *keys)


def camera_of(at, **options):
    told = {"source": "ros2", "endpoint": at.endpoint, "depth": DEPTH, "kind": "distance", "wait": 20}
    return make_camera("zenoh", told | options)


def grab_on(camera):
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        with suppress(DeviceTimeoutError):
            camera.grab(0.1)


def test_images_of_ros_2_become_frames(source):
    robot = Robot(source, domain=7)
    robot.info()
    robot.images(light=True)
    with camera_of(source, domain=7, amplitude="/" + LIGHT) as camera:
        camera.start()
        frames = [camera.grab() for _ in range(4)]
        assert camera.calibration.intrinsics.fx == K[0]
        assert not camera.capabilities.carries_pose
    for frame in frames:
        assert frame.ambiguity_range is None
        assert abs(frame.timestamp - time.time_ns()) < 60e9
        first = frame.distance[5, 5]
        number = round(first * 1000) - int(depth_image()[5, 5])
        np.testing.assert_array_equal(frame.amplitude, amplitude_image(number))
        assert frame.valid.sum() == frame.counts.size - 2
    assert all(np.diff([frame.sequence for frame in frames]) > 0)


def test_messages_of_foxglove_become_frames(source):
    from drivers.calibration import Calibration, Intrinsics
    from drivers.messages import calibration_message, image_message

    lens = Intrinsics(fx=50, fy=50, cx=27, cy=19)
    known = Calibration(width=SHAPE[1], height=SHAPE[0], intrinsics=lens)
    source.put_message("robot/eye", calibration_message(known, 1, topic="calibration"), latched=True)
    metres = (depth_image() * 1e-3).astype(np.float32)

    def publish(_):
        source.put_message("robot/eye", image_message("depth", metres, "32FC1", "eye", time.time_ns()))

    source.repeat(publish, "robot/eye/depth")
    with camera_of(source, source="foxglove", depth="robot/eye/depth", kind="depth") as camera:
        camera.start()
        frame = camera.grab()
    x = (5 - lens.cx) / lens.fx
    y = (7 - lens.cy) / lens.fy
    assert frame.distance[7, 5] == pytest.approx(metres[7, 5] * np.sqrt(1 + x * x + y * y), rel=1e-6)


@pytest.mark.parametrize("stamp", [lambda: 0, lambda: 1_000_000_000])
def test_stamps_of_another_clock_give_way_to_the_arrival(source, stamp, caplog):
    robot = Robot(source)
    robot.info()
    robot.images(stamp)
    with camera_of(source) as camera:
        camera.start()
        frames = [camera.grab(), camera.grab()]
    assert all(abs(frame.timestamp - time.time_ns()) < 60e9 for frame in frames)
    assert frames[0].timestamp_uncertainty > 0
    assert len([record for record in caplog.records if "times of arrival" in record.message]) == 1


def test_without_optics_it_says_what_is_missing(source):
    Robot(source).images()
    with pytest.raises(NotAvailableError, match=r"camera information \(0/camera/depth/camera_info/"):
        camera_of(source, wait=0.5).open()


def test_without_images_it_says_so(source):
    Robot(source).info()
    with pytest.raises(NotAvailableError, match=r"depth image \(0/camera/depth/image_raw/"):
        camera_of(source, wait=0.5).open()


def test_nobody_there_is_one_line(source):
    with pytest.raises(NotAvailableError, match="no Zenoh session"):
        camera_of(source, endpoint="tcp/127.0.0.1:9").open()


def test_a_camera_that_falls_silent_is_lost(source):
    robot = Robot(source)
    robot.info()
    robot.images()
    with camera_of(source, silence=0.3) as camera:
        camera.start()
        camera.grab()
        source.close()
        with pytest.raises(DeviceLostError, match="no image came"):
            grab_on(camera)


def test_images_that_change_size_open_the_camera_anew(source):
    robot = Robot(source)
    robot.info()
    robot.images()
    with camera_of(source) as camera:
        camera.start()
        camera.grab()
        source.close()
        robot.info(shape=(20, 28))
        robot.images(shape=(20, 28))
        with pytest.raises(DeviceLostError, match="changed from"):
            grab_on(camera)


def test_garbage_among_images_is_passed_over(source, caplog):
    robot = Robot(source)
    robot.info()
    robot.images()
    with camera_of(source) as camera:
        camera.start()
        first = camera.grab()
        for _ in range(10):
            source.put(key_of(DEPTH, "sensor_msgs/msg/Image"), b"\0\1\0\0garbage")
        later = [camera.grab() for _ in range(30)]
    assert later[-1].sequence > first.sequence
    told = [record for record in caplog.records if "cannot be used" in record.message]
    assert 1 <= len(told) <= 5


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"kind": None}, "kind is missing"),
        ({"depth": None}, "depth is missing"),
        ({"endpoint": None}, "expected endpoint or config"),
        ({"depth": "camera/**"}, "depth"),
    ],
)
def test_options_that_are_not_enough_are_refused(source, options, said):
    with pytest.raises(InitialisationError, match=said):
        camera_of(source, **options)
