"""The whole service on a USB camera and a serial stage: stand-ins behind the real drivers' transports."""

import json
import socket
import sys
import time
from math import radians
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

from drivers import Frame
from drivers.mesasr import library
from drivers.messages import decode_image
from drivers.recording import open_recording
from drivers.usb import discovery
from service.capture.configured import make_rig
from service.config.file import load
from service.daemon.run import run_service
from service.messages.events import FrameCaptured, MapFused
from service.sinks.sink import Sink

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from emulators.ptu_emulator import PtuEmulator
from usb_standin import StandIn

POSES = 4


@pytest.fixture
def camera(monkeypatch):
    """An SR4000 at 50 frames/s behind pyusb."""
    stand_in = StandIn(period=0.018, record=False)
    monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
    monkeypatch.setattr(library, "FOLDERS", [])
    return stand_in


@pytest.fixture
def configuration(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))

    def configure(port):
        sections = {
            "camera": {"backend": "auto", "options": {"allow_inferred": True}},
            "stage": {"backend": "ptu", "options": {"port": str(port)}},
            "fusion": {
                "method": "nearest",
                "upsampling": 2,
                "register_poses": False,
                "frames": POSES,
            },
            "zenoh": {"config": str(zenoh)},
        }
        return load(None, sections)

    return configure


class Meddler(Sink):
    """Stops the service after some maps; calls a fault after each of the frames that are named."""

    def __init__(self, maps, faults):
        super().__init__()
        self.maps, self.faults = maps, faults
        self.frames: list[tuple[float, Frame]] = []
        self.seen = 0

    def started(self, daemon):
        self.daemon = daemon

    def take(self, event):
        if isinstance(event, FrameCaptured):
            self.frames.append((time.monotonic(), event.frame))
            if fault := self.faults.get(len(self.frames)):
                fault()
        elif isinstance(event, MapFused):
            self.seen += 1
            if self.seen >= self.maps:
                self.daemon.stop.set()


def test_a_burst_is_captured_turned_fused_and_written(camera, configuration, tmp_path):
    with PtuEmulator() as stage:
        settings = configuration(stage.port)
        output = tmp_path / "out"
        summary = run_service(settings, make_rig(settings), output=output, once=True)
    assert (summary.frames, summary.maps, summary.lost) == (POSES, 1, ())
    recording = open_recording(output / "fused.mcap")
    frames = list(recording.frames())
    step = radians(185.1428 / 3600)
    angles = np.array([(frame.pan, frame.tilt) for frame in frames]) / step
    np.testing.assert_allclose(
        angles, np.round(angles), atol=1e-6
    )  # whole positions, as the unit reports them
    assert len({tuple(angle) for angle in np.round(angles)}) > 1
    assert recording.metadata["camera_model"] == "SR4000"
    depth = {m.topic: m for m, _ in recording.messages()}["fused/depth"]
    image = decode_image(depth.payload)
    assert image.shape == (288, 352)
    assert 0.8 < np.nanmin(image) < 1.0  # the box at 12000 counts of 5 m / 65536
    assert camera.claimed is False


def test_unplugging_in_a_burst_costs_that_burst_and_three_seconds_at_most(camera, configuration):
    back = []

    def pull_the_plug():
        camera.unplug()

        def put_back():
            camera.replug()
            back.append(time.monotonic())

        Timer(0.4, put_back).start()

    with PtuEmulator() as stage:
        settings = configuration(stage.port)
        meddler = Meddler(3, {POSES + 2: pull_the_plug})
        rig = make_rig(settings)
        summary = run_service(settings, rig, sinks={"meddler": lambda: meddler}, started=meddler.started)
    assert summary.maps >= 3
    assert rig.reopened >= 1
    first_after = next(at for at, _ in meddler.frames if at > back[0])
    assert first_after - back[0] < 3
    # the burst was taken again, whole: its first two frames, then all four
    assert [frame.pose for _, frame in meddler.frames[POSES : 2 * POSES + 2]] == [0, 1, 0, 1, 2, 3]
    assert {frame.burst for _, frame in meddler.frames[POSES : 2 * POSES + 2]} == {1}


def test_bad_frames_are_taken_again_and_no_burst_is_lost(camera, configuration):
    def next_one(fault):
        return lambda: camera.faults.update({camera.triggers + 1: fault})

    kinds = ("short", "garbage", "stall", "silent", "eio", "late")
    with PtuEmulator() as stage:
        settings = configuration(stage.port)
        meddler = Meddler(4, {2 * n + 1: next_one(kind) for n, kind in enumerate(kinds)})
        rig = make_rig(settings)
        summary = run_service(settings, rig, sinks={"meddler": lambda: meddler}, started=meddler.started)
    assert summary.maps >= 4
    assert rig.reopened == 0
    assert len(camera.faults) == len(kinds)
    assert [(frame.burst, frame.pose) for _, frame in meddler.frames[: 4 * POSES]] == [
        (burst, pose) for burst in range(4) for pose in range(POSES)
    ]
    assert rig.camera.is_open is False
