"""A scanning rig through every fault of its stage and camera: real drivers, a unit on a pty, a service."""

import json
import os
import signal
import subprocess
import sys
import time
from itertools import islice
from math import radians
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

from drivers.mesasr import library
from drivers.usb import discovery
from service.capture.configured import make_rig
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.motion import Operator
from service.capture.scan import ScanBursts
from service.capture.series import Capture
from service.config.sections import CameraSection, Configuration, PlanSection, StageSection
from service.errors import MotionError
from service.planning.plan import make_plan

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from emulators.ptu_emulator import PtuEmulator
from usb_standin import StandIn

pytestmark = pytest.mark.faults

POSES = 4
STEP = radians(185.1428 / 3600)
ROOT = Path(__file__).parents[2]


@pytest.fixture
def camera(monkeypatch):
    """An SR4000 at 50 frames/s behind pyusb."""
    stand_in = StandIn(period=0.018, record=False)
    monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
    monkeypatch.setattr(library, "FOLDERS", [])
    return stand_in


class Scan:
    """Two bursts of four poses; a fault comes in the middle of the second one."""

    def __init__(self, port, home, fault=lambda _: None, operator=None):
        configuration = Configuration(
            camera=CameraSection(backend="usb", options={"allow_inferred": True}),
            stage=StageSection(backend="ptu", options={"port": str(port)}, settle=0.0, home=home),
            plan=PlanSection(span=3.0),
        )
        self.seen = []
        self._fault = fault
        self.rig = make_rig(configuration, operator=operator)
        self.rig.open()
        grabber = Grabber(self.rig, configuration.camera.timeout, Control(), self._watch)
        self.plan = make_plan(
            configuration.plan, POSES, self.rig.calibration.intrinsics, resolution=self.rig.stage.resolution
        )
        self.capture = Capture(grabber, ScanBursts(grabber, self.plan, 0.0, 10.0))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.rig.close()

    def take(self):
        return list(islice(self.capture.run(), 2))

    def _watch(self, frame):
        self.seen.append(frame)
        if len(self.seen) == POSES + 2:
            self._fault(self.rig)


def lose_power(unit):
    unit.power_cycle()


def lose_the_cable(unit):
    unit.unplug()
    Timer(0.3, unit.plug).start()


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize("fault", [lose_power, lose_the_cable])
def test_the_interrupted_burst_is_taken_again_once_homed_as_configured(tmp_path, fault):
    with PtuEmulator(tmp_path / "ptu", boot_seconds=0.3) as unit:
        with Scan(unit.port, "at start", lambda _: fault(unit)) as scan:
            bursts = scan.take()
            assert not scan.rig.stage.needs_home
        assert unit.commands.count("R") == 1
    assert scan.capture.counts.interrupted == scan.capture.counts.lost == scan.rig.reopened == 1
    assert [frame.pose for frame in scan.seen] == [0, 1, 2, 3, 0, 1, 0, 1, 2, 3]
    expected = np.round([[pose.pan / STEP, pose.tilt / STEP] for pose in scan.plan.poses])
    for burst in bursts:
        angles = np.array([(frame.pan, frame.tilt) for frame in burst.frames]) / STEP
        np.testing.assert_allclose(angles, expected, atol=1e-6)


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize(
    ("home", "fault", "reason"),
    [
        ("ask", lose_power, "has restarted"),
        ("never", lose_the_cable, "the serial line is gone"),
        ("at start", lambda unit: unit.run_into_limit("P"), "the pan axis hit a limit"),
    ],
)
def test_the_stage_stands_still_after_a_fault_that_needs_a_person(tmp_path, home, fault, reason):
    with PtuEmulator(tmp_path / "ptu", boot_seconds=0.3) as unit:
        with Scan(unit.port, home, lambda _: fault(unit)) as scan:
            with pytest.raises(MotionError, match=reason):
                scan.take()
            moves = len(unit.moves)
            with pytest.raises(MotionError):
                scan.take()
        assert len(unit.moves) == moves
        assert "R" not in unit.commands


def test_a_lost_camera_neither_moves_the_stage_nor_costs_its_position(tmp_path, camera):
    with PtuEmulator(tmp_path / "ptu") as unit:

        def lose_the_camera(_):
            camera.unplug()
            Timer(0.3, camera.replug).start()

        with Scan(unit.port, "never", lose_the_camera) as scan:
            bursts = scan.take()
        assert len(bursts) == 2
        assert scan.rig.reopened == 1
        assert unit.commands.count("FV") == 2, "the unit stays open: its greeting is said only once"


@pytest.mark.usefixtures("camera")
def test_what_moves_is_announced_before_it_moves(tmp_path):
    with PtuEmulator(tmp_path / "ptu") as unit:

        class Person(Operator):
            def tell(self, what):
                told.append((what, len(unit.moves)))

        told = []
        with Scan(unit.port, "ask", operator=Person()) as scan:
            scan.take()
    ((said, moves),) = told
    assert moves == 0
    assert f"PtuStage on {unit.port} is about to turn from pan 0.00°, tilt 0.00° to pan" in said
    assert said.endswith("at most 10.0°/s")


@pytest.fixture
def slow_move(tmp_path):
    """A configuration whose first pose takes six seconds to reach, and the environment to run it in."""
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": ["tcp/127.0.0.1:0"]}}))
    path = tmp_path / "rig.toml"
    path.write_text(
        f"""
        camera = {{ backend = "simulated", options = {{ scene = "plane" }} }}
        stage = {{ backend = "ptu", options = {{ port = "{tmp_path / "ptu"}" }} }}
        plan = {{ pan = 60.0 }}
        fusion = {{ method = "nearest", register_poses = false }}
        zenoh = {{ config = "{zenoh}" }}
        """
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("LIDARBOOST_")}
    return path, environment


def test_ctrl_c_in_mid_move_halts_the_stage_at_once(tmp_path, slow_move):
    path, environment = slow_move
    with PtuEmulator(tmp_path / "ptu") as unit:
        service = subprocess.Popen(
            [sys.executable, "-c", "from service.cli import main; main()", "run", str(path)],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        while not unit.moving:
            assert service.poll() is None, service.stdout.read()
            time.sleep(0.01)
        time.sleep(0.5)
        assert unit.moving
        before = len(unit.halts)
        sent = time.monotonic()
        service.send_signal(signal.SIGINT)
        said, _ = service.communicate(timeout=60)
        assert not unit.moving
        # 0.2 s is what is promised, and shown in virtual time; the rest is for a busy machine.
        assert unit.halts[before] - sent < 0.5
        assert "is about to turn from pan 0.00°, tilt 0.00° to pan 59.90° to 60.10°" in said
        assert service.returncode == 0
