"""What holds for every camera and every stage backend, present and future.

A new backend adds to `CAMERA_WORLDS` or `STAGE_WORLDS` what it needs to be made here: a function that plugs
its device in and returns one that makes closed drivers for it.
"""

import shutil
import subprocess
from contextlib import ExitStack
from math import inf, nan, radians
from pathlib import Path

import numpy as np
import pytest
from emulators.dynamixel_emulator import DynamixelEmulator
from emulators.grbl_emulator import GrblEmulator
from emulators.ptu_emulator import PtuEmulator
from made_frames import make_bursts
from usb_standin import SR4000_IDS, StandIn
from zenoh_source import rig_frames, zenoh_source

from drivers import (
    Calibration,
    Camera,
    Frame,
    InitialisationError,
    LimitError,
    NotAvailableError,
    Position,
    Stage,
    StateError,
    backend_names,
    make_camera,
    make_stage,
    sr3000_calibration,
)
from drivers.backends import camera_class, stage_class
from drivers.calibration import Mount
from drivers.clock import VirtualClock
from drivers.fixed import FixedStage
from drivers.mesasr import library
from drivers.recording import RecordingWriter
from drivers.usb import discovery

START = 1_700_000_000 * 10**9


def replayed(world):
    path = world.folder / "contract.mcap"
    with RecordingWriter(path) as writer:
        writer.write_calibration(sr3000_calibration(), START)
        for frame in make_bursts(2, 3):
            writer.write_frame(frame, Mount())
    return lambda: make_camera("replay", {"path": path}, VirtualClock(START))


def simulated(world):  # noqa: ARG001
    return lambda: make_camera("simulated", {"scene": "plane"}, VirtualClock(START))


def on_usb(world, name="usb"):
    clock = VirtualClock(START)
    device = StandIn(SR4000_IDS, clock=clock)
    world.patch.setattr(discovery, "libusb", lambda: device)
    world.patch.setattr(library, "FOLDERS", [])
    return lambda: make_camera(name, {"allow_inferred": True}, clock)


def found_by_itself(world):
    return on_usb(world, "auto")


def vendor_library(world):
    # In real time: the stub answers at once, and virtual time would stand still.
    return lambda: make_camera("mesasr", {"library": world.stub()})


def another_rig(world):
    source = world.stack.enter_context(zenoh_source())
    rig_frames(source)
    return lambda: make_camera("zenoh", {"endpoint": source.endpoint, "prefix": "far/rig"})


CAMERA_WORLDS = {
    "auto": found_by_itself,
    "mesasr": vendor_library,
    "replay": replayed,
    "simulated": simulated,
    "usb": on_usb,
    "zenoh": another_rig,
}


def emulated(emulator, name):
    def plugged(world):
        port = world.stack.enter_context(emulator()).port
        return lambda: make_stage(name, {"port": port})

    return plugged


STAGE_WORLDS = {
    "dynamixel": emulated(DynamixelEmulator, "dynamixel"),
    "grbl": emulated(GrblEmulator, "grbl"),
    "none": lambda world: lambda: make_stage("none"),  # noqa: ARG005
    "ptu": emulated(PtuEmulator, "ptu"),
    "simulated": lambda world: lambda: make_stage("simulated", clock=VirtualClock(START)),  # noqa: ARG005
}


class World:
    """What a backend may need around it in a test."""

    def __init__(self, folder, patch, stack, stub):
        self.folder, self.patch, self.stack, self.stub = folder, patch, stack, stub


@pytest.fixture(scope="module")
def stub(tmp_path_factory):
    """Builds the stub of the vendor's library, once."""
    path = tmp_path_factory.mktemp("library") / "libmesasr.so"

    def build():
        compiler = shutil.which("gcc") or shutil.which("cc")
        if compiler is None:
            pytest.skip("no C compiler for the stub library")
        if not path.exists():
            source = Path(__file__).with_name("mesasr_stub.c")
            subprocess.run([compiler, "-shared", "-fPIC", "-o", path, source, "-lm"], check=True)
        return path

    return build


@pytest.fixture
def world(tmp_path, monkeypatch, stub):
    with ExitStack() as stack:
        yield World(tmp_path, monkeypatch, stack, stub)


@pytest.fixture(params=backend_names("camera"))
def camera(request, world):
    assert request.param in CAMERA_WORLDS, f"say in CAMERA_WORLDS how a {request.param!r} camera is made here"
    made = CAMERA_WORLDS[request.param](world)()
    yield made
    made.close()


@pytest.fixture(params=backend_names("stage"))
def stage(request, world):
    assert request.param in STAGE_WORLDS, f"say in STAGE_WORLDS how a {request.param!r} stage is made here"
    made = STAGE_WORLDS[request.param](world)()
    yield made
    made.close()


@pytest.mark.parametrize(("kind", "worlds"), [("camera", CAMERA_WORLDS), ("stage", STAGE_WORLDS)])
def test_every_backend_is_held_to_the_contract(kind, worlds):
    assert sorted(worlds) == backend_names(kind)


@pytest.mark.parametrize(
    ("find", "name", "base"),
    [(camera_class, name, Camera) for name in backend_names("camera")]
    + [(stage_class, name, Stage) for name in backend_names("stage")],
)
def test_a_backend_describes_itself_and_its_options(find, name, base):
    found = find(name)
    assert issubclass(found, base)
    assert found.__doc__
    assert found.__doc__ != base.__doc__
    for option, field in found.Options.model_fields.items():
        assert field.description, f"{name}.{option} has no description"
    assert found.Options.model_config["extra"] == "forbid"
    assert found.Options.model_config["frozen"]


@pytest.mark.parametrize(
    ("make", "name"),
    [(make_camera, name) for name in backend_names("camera")]
    + [(make_stage, name) for name in backend_names("stage")],
)
def test_an_option_it_does_not_know_is_refused_by_name(make, name):
    with pytest.raises(InitialisationError, match=rf"{name}.*no_such_option"):
        make(name, {"no_such_option": 1})


@pytest.mark.parametrize("make", [make_camera, make_stage])
def test_a_backend_that_is_not_there_says_which_are(make):
    with pytest.raises(NotAvailableError, match=r"'teapot'.*simulated"):
        make("teapot")


def test_a_closed_camera_says_so(camera):
    assert not camera.is_open
    camera.close()
    camera.stop()
    for action in (
        camera.start,
        camera.grab,
        lambda: camera.calibration,
        lambda: camera.capabilities,
        lambda: setattr(camera, "settings", camera.settings),
    ):
        with pytest.raises(StateError, match=r"open it first|start it first"):
            action()


def test_a_camera_knows_what_it_is(camera):
    camera.open()
    camera.open()
    assert camera.is_open
    assert not camera.is_started
    what = camera.capabilities
    assert what.source in ("device", "replay", "simulation")
    assert what.model
    assert isinstance(camera.calibration, Calibration)
    assert camera.calibration.shape == what.shape
    with pytest.raises(StateError, match="start it first"):
        camera.grab()


def test_frames_are_whole_in_order_and_agree_with_the_camera(camera):
    with camera:
        camera.start()
        camera.start()
        assert camera.is_started
        frames = [camera.grab() for _ in range(3)]
        settings, what = camera.settings, camera.capabilities
    for frame in frames:
        assert isinstance(frame, Frame)
        assert frame.shape == what.shape
        assert frame.modulation_frequency == settings.modulation_frequency
        assert frame.amplitude_mode == settings.amplitude_mode
        assert frame.timestamp_uncertainty >= 0
        valid = frame.distance[frame.valid]
        assert valid.size > frame.counts.size / 2
        assert (valid > 0).all()
        assert (valid < frame.ambiguity_range).all()
        assert np.isnan(frame.distance[~frame.valid]).all()
        assert np.nanmin(frame.signal) >= 0
    assert all(np.diff([frame.sequence for frame in frames]) > 0)
    assert all(np.diff([frame.timestamp for frame in frames]) > 0)
    if what.carries_pose:
        assert [frame.pose for frame in frames] == [0, 1, 2]
    else:
        assert {(frame.burst, frame.pose) for frame in frames} == {(None, None)}


def test_what_a_frame_holds_does_not_change_with_the_next(camera):
    with camera:
        camera.start()
        first = camera.grab()
        before = first.counts.copy(), first.amplitude.copy()
        camera.grab()
        np.testing.assert_array_equal(first.counts, before[0])
        np.testing.assert_array_equal(first.amplitude, before[1])


def test_a_stopped_camera_gives_no_frame_until_it_is_started_again(camera):
    with camera:
        camera.start()
        last = camera.grab()
        camera.stop()
        camera.stop()
        assert not camera.is_started
        with pytest.raises(StateError, match="start it first"):
            camera.grab()
        camera.start()
        assert camera.grab().sequence > last.sequence


def test_a_camera_can_be_opened_again_after_closing_in_full_run(camera):
    for _ in range(2):
        camera.open()
        camera.start()
        assert camera.grab().valid.any()
        camera.close()
        assert not camera.is_open
        assert not camera.is_started
        camera.close()


def test_leaving_by_an_exception_closes_the_camera(camera):
    def fail():
        with camera:
            camera.start()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert not camera.is_open
    assert not camera.is_started


def test_a_camera_takes_the_settings_it_has(camera):
    with camera:
        settings = camera.settings
        camera.settings = settings
        assert camera.settings == settings
        camera.start()
        assert camera.grab().modulation_frequency == settings.modulation_frequency


def test_a_camera_may_stand_on_a_stage(camera):
    with FixedStage() as fixed:
        camera.mount_on(fixed)
        with camera:
            camera.start()
            assert camera.grab().shape == camera.capabilities.shape


def test_a_closed_stage_says_so(stage):
    assert not stage.is_open
    stage.close()
    for action in (
        stage.home,
        stage.wait,
        stage.stop,
        lambda: stage.speed,
        lambda: stage.homing,
        lambda: stage.move_to(0.0, 0.0),
        lambda: stage.position,
        lambda: stage.limits,
        lambda: stage.resolution,
    ):
        with pytest.raises(StateError, match="open it first"):
            action()


def test_a_stage_knows_its_limits_and_steps(stage):
    with stage:
        stage.open()
        limits = stage.limits
        for low, high in (limits.pan, limits.tilt):
            assert -inf < low <= 0.0 <= high < inf
        assert 0.0 <= stage.resolution < radians(5)
        assert stage.needs_home == (stage.uncertainty is not None)
        if not stage.needs_home:
            assert isinstance(stage.position, Position)


def test_a_stage_goes_where_it_is_sent_and_home(stage):
    with stage:
        limits, near = stage.limits, max(stage.resolution, radians(0.1))
        stage.home()
        assert (stage.position.pan, stage.position.tilt) == pytest.approx((0.0, 0.0), abs=near)
        targets = [
            Position(max(radians(-4), limits.pan[0]), min(radians(3), limits.tilt[1])),
            Position(min(radians(2), limits.pan[1]), max(radians(-1), limits.tilt[0])),
        ]
        for target in targets:
            stage.move_to(target.pan, target.tilt)
            stage.wait()
            reached = stage.position
            assert (reached.pan, reached.tilt) == pytest.approx((target.pan, target.tilt), abs=near)
        stage.home()
        assert (stage.position.pan, stage.position.tilt) == pytest.approx((0.0, 0.0), abs=near)


def test_waiting_for_a_stage_at_rest_returns(stage):
    with stage:
        stage.home()
        stage.wait()
        stage.move_to(0.0, 0.0)
        stage.wait()
        stage.wait()


@pytest.mark.parametrize("beyond", [(4.0, 0.0), (0.0, -4.0), (nan, 0.0), (0.0, inf)])
def test_angles_beyond_the_limits_are_refused_and_nothing_moves(stage, beyond):
    with stage:
        stage.home()
        before = stage.position
        with pytest.raises(LimitError, match="nothing was sent"):
            stage.move_to(*beyond)
        assert stage.position == before


def test_a_stage_can_be_opened_again(stage):
    for _ in range(2):
        with stage:
            assert stage.is_open
            stage.home()
        assert not stage.is_open
        stage.close()


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in ("camera", "stage") for name in backend_names(kind)]
)
def test_an_error_of_the_system_on_opening_says_where_and_what_to_do(kind, name, monkeypatch):
    make = {"camera": camera_class, "stage": stage_class}[kind](name)
    device = make(make.Options.model_construct())

    def refused() -> None:
        raise PermissionError(13, "Permission denied", "/dev/ttyUSB7")

    monkeypatch.setattr(device, "_open", refused)
    with pytest.raises(NotAvailableError, match="cannot be opened: /dev/ttyUSB7: Permission denied; check"):
        device.open()
    assert not device.is_open
