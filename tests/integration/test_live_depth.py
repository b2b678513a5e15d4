"""The whole service on images that others publish: a ROS 2 depth camera, another rig."""

import json
import socket
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from drivers import sr3000_calibration
from drivers.calibration import Mount
from drivers.messages import calibration_message, decode_image, frame_messages
from drivers.recording import open_recording
from service.capture.configured import make_rig
from service.config.file import load
from service.daemon.run import run_service

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from made_bags import SHAPE, Ros, depth_image
from made_frames import make_frame
from zenoh_source import zenoh_source

pytestmark = pytest.mark.slow  # two services are started

FRAMES = 4
IMAGE, INFO = (
    f"0/eye/depth/{name}/sensor_msgs::msg::dds_::{kind}_/RIHS01_1"
    for name, kind in (("image_raw", "Image"), ("camera_info", "CameraInfo"))
)


@pytest.fixture
def source():
    with zenoh_source() as made:
        yield made


@pytest.fixture
def fused(tmp_path, source):
    """What one pass of the service makes of a source: its summary and its recording."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))

    def fuse(**options):
        sections = {
            "camera": {"backend": "zenoh", "options": {"endpoint": source.endpoint, "wait": 20} | options},
            "fusion": {"method": "nearest", "upsampling": 2, "register_poses": False, "frames": FRAMES},
            "zenoh": {"config": str(zenoh)},
            "ros2": {"enabled": True, "domain": 9},
        }
        settings = load(None, sections)
        summary = run_service(settings, make_rig(settings), output=tmp_path / "out", once=True)
        return summary, open_recording(tmp_path / "out" / "fused.mcap")

    return fuse


def test_a_depth_camera_under_ros_2_is_fused(source, fused):
    bag = Ros()
    bag.info()
    payload = bag.store.serialize_cdr(bag.written[0].message, bag.written[0].kind)
    source.put(INFO, bytes(payload), "application/cdr", latched=True)

    def publish(number):
        one = Ros()
        one.image(depth_image(number % 50), time.time_ns())
        source.put(IMAGE, bytes(one.store.serialize_cdr(one.written[0].message, one.written[0].kind)))

    source.repeat(publish, IMAGE)
    summary, recording = fused(source="ros2", depth="/eye/depth/image_raw", kind="depth")
    assert (summary.frames, summary.maps, summary.lost) == (FRAMES, 1, ())
    frames = list(recording.frames())
    assert [frame.amplitude for frame in frames] == [None] * FRAMES
    assert {frame.counts.dtype for frame in frames} == {np.dtype("f4")}
    depth = {message.topic: message for message, _ in recording.messages()}["fused/depth"]
    image = decode_image(depth.payload)
    assert image.shape == (2 * SHAPE[0], 2 * SHAPE[1])
    assert np.nanmedian(image) == pytest.approx(np.median(depth_image()) * 1e-3, abs=0.06)


def test_another_rig_is_fused_with_its_poses(source, fused):
    prefix = "far/rig"
    source.put_message(prefix, calibration_message(sr3000_calibration(), 1), latched=True)

    def publish(number):
        burst, pose = divmod(number, 3)
        for message in frame_messages(make_frame(number, burst=burst, pose=pose), Mount()):
            source.put_message(prefix, message)

    keys = [f"{prefix}/camera/{name}" for name in ("distance", "amplitude", "frame")]
    source.repeat(publish, *keys, period=0.05)
    summary, recording = fused(prefix=prefix)
    assert summary.maps == 1
    frames = list(recording.frames())
    assert [frame.pose for frame in frames] == [0, 1, 2]
    assert frames[1].pan == pytest.approx(0.001 * (frames[1].sequence - 100))
    assert frames[0].ambiguity_range == 7.5
