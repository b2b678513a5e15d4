"""Bursts through every fault of a stage: the real serial driver on a pty, a camera behind pyusb."""

import sys
from itertools import islice
from math import radians
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

from drivers.mesasr import library
from drivers.usb import discovery
from service.capture.control import Control
from service.capture.loop import Grabber, ScanBursts
from service.capture.rig import make_rig
from service.capture.series import Capture
from service.config.sections import CameraSection, Configuration, PlanSection, StageSection
from service.planning.plan import make_plan

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from emulators.ptu_emulator import PtuEmulator
from usb_standin import StandIn

POSES = 4
STEP = radians(185.1428 / 3600)


@pytest.fixture
def camera(monkeypatch):
    """An SR4000 at 50 frames/s behind pyusb."""
    stand_in = StandIn(period=0.018, record=False)
    monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
    monkeypatch.setattr(library, "FOLDERS", [])
    return stand_in


def for_a_while(begin, end, seconds):
    begin()
    Timer(seconds, end).start()


def hit_a_limit(unit):
    unit.run_into_limit("P")


def stop_answering(unit):
    for_a_while(lambda: setattr(unit, "mute", True), lambda: setattr(unit, "mute", False), 2.5)


def lose_power(unit):
    unit.power_cycle()


def lose_the_cable(unit):
    for_a_while(unit.unplug, unit.plug, 0.3)


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize("fault", [hit_a_limit, stop_answering, lose_power, lose_the_cable])
def test_the_interrupted_burst_is_taken_again_from_a_known_position(tmp_path, fault):
    configuration = Configuration(
        camera=CameraSection(backend="usb", options={"allow_inferred": True}),
        stage=StageSection(backend="ptu", options={"port": str(tmp_path / "ptu")}, settle=0.0),
        plan=PlanSection(span=3.0),
    )
    seen = []
    with PtuEmulator(tmp_path / "ptu", boot_seconds=0.3) as unit:

        def watch(frame):
            seen.append(frame)
            if len(seen) == POSES + 2:  # in the middle of the second burst
                fault(unit)

        rig = make_rig(configuration)
        rig.open()
        grabber = Grabber(rig, configuration.camera.timeout, Control(), watch)
        plan = make_plan(
            configuration.plan, POSES, rig.calibration.intrinsics, resolution=rig.stage.resolution
        )
        capture = Capture(grabber, ScanBursts(grabber, plan, 0.0, 10.0))
        bursts = list(islice(capture.run(), 2))
        assert not rig.stage.needs_home
        rig.close()
    assert capture.counts.interrupted == capture.counts.lost == rig.reopened == 1
    assert [frame.pose for frame in seen] == [0, 1, 2, 3, 0, 1, 0, 1, 2, 3]
    expected = np.round([[pose.pan / STEP, pose.tilt / STEP] for pose in plan.poses])
    for burst in bursts:
        angles = np.array([(frame.pan, frame.tilt) for frame in burst.frames]) / STEP
        np.testing.assert_allclose(angles, expected, atol=1e-6)
