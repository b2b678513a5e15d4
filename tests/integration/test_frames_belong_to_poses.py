"""No frame from before a movement is given to the pose after it, whatever happens on the bus."""

import ctypes
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from drivers.calibration import sr4000_calibration
from drivers.clock import Clock, VirtualClock
from drivers.mesasr import MesaCamera
from drivers.usb import UsbCamera, discovery
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.rig import Rig
from service.capture.scan import ScanBursts
from service.capture.series import Capture
from service.config.sections import PlanSection
from service.planning.plan import make_plan

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))
sys.path.insert(0, str(Path(__file__).parents[1] / "service"))

from scripted import ScriptedStage
from usb_standin import SR2_IDS, SR4000_IDS, StandIn, scene

POSES, BURSTS = 4, 2

FAULTS = (
    "silent", "short", "late", "delayed 0.05", "delayed 0.2", "stall", "stall queued", "eio", "eio queued",
    "refused", "refused exposed", "doubled", "exposed twice", "garbage", "constant", "rolled", "swapped",
    "unplug",
)  # fmt: skip

SR4000 = {"ids": SR4000_IDS}
SR2B = {"ids": SR2_IDS, "shape": (160, 124), "planes": 3, "bulk_in": 0x88}
"""The integration time of the first is unknown (at most 25.8 ms), that of the second is set to 10 ms."""

PICTURES = {SR4000_IDS: scene(144, 176, 1)[2:], SR2_IDS: scene(160, 124, 1, 3)[2:]}


class LoggedStage(ScriptedStage):
    """Keeps when each movement began and ended."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock)
        self.log: list[tuple[int, int, tuple[float, float]]] = []

    def wait(self, timeout: float = 10.0) -> None:
        began = self.clock.now()
        super().wait(timeout)
        self.log.append((began, self.clock.now(), self.moves[-1]))


class Bench:
    """A scan with the real USB driver; each picture carries the number of its exposure."""

    def __init__(
        self,
        faults: Mapping[int, str],
        period: float,
        ahead: float,
        settle: float,
        camera: Mapping[str, Any] = SR4000,
    ) -> None:
        self.settle = round(settle * 1e9)
        clock = Replugging(self)
        self.stand_in = StandIn(
            clock=clock,
            period=period,
            ahead=ahead,
            faults=faults,
            frames=lambda number: (4 * number).to_bytes(2, "little") + PICTURES[camera["ids"]],
            number_by_exposure=True,
            record=False,
            **camera,
        )
        self.stage = LoggedStage(clock)
        model = "SR2B" if camera is SR2B else None
        self.rig = Rig(
            UsbCamera(UsbCamera.Options(allow_inferred=True, model=model), clock), self.stage, clock
        )
        self.stop = Event()

    def scan(self) -> list[tuple[int, int, tuple[float, float]]]:
        """Exposure and pose of each frame of some bursts."""
        self.rig.open()
        grabber = Grabber(self.rig, 0.4, Control(self.stop))
        plan = make_plan(PlanSection(), POSES, self.rig.calibration.intrinsics)
        capture = Capture(grabber, ScanBursts(grabber, plan, self.settle / 1e9, 10.0))
        found = []
        for burst, _ in zip(capture.run(), range(BURSTS), strict=False):
            assert [frame.pose for frame in burst.frames] == list(range(POSES))
            for frame in burst.frames:
                pose = plan.poses[frame.pose or 0]
                found.append((*self.stand_in.exposures[int(frame.counts[0, 0]) // 4], (pose.pan, pose.tilt)))
        self.rig.close()
        return found

    def check(self, began: int, ended: int, pose: tuple[float, float]) -> None:
        """The stage stood at the pose from before the exposure until after it."""
        _, arrived, target = [move for move in self.stage.log if move[0] <= began][-1]
        assert target == pose
        assert arrived + self.settle <= began
        assert all(began_to_move >= ended for began_to_move, _, _ in self.stage.log if began_to_move > began)


class StubClock:
    """The time of the stub of the vendor's library."""

    def __init__(self, levers: ctypes.CDLL) -> None:
        self._levers = levers
        levers.stub_now.restype = ctypes.c_int64

    def now(self) -> int:
        return int(self._levers.stub_now())

    def correction(self) -> int:
        return 0

    def sleep(self, seconds: float) -> None:
        self._levers.stub_pass(ctypes.c_int64(max(0, round(seconds * 1e9))))


class Replugging(VirtualClock):
    """Time in which an unplugged camera is plugged in again after a while."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(1_000_000_000)
        self._bench = bench

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        if seconds >= 0.05 and not self._bench.stand_in.plugged:
            self._bench.stand_in.replug()


@given(
    faults=st.dictionaries(st.integers(1, 24), st.sampled_from(FAULTS), max_size=10),
    camera=st.sampled_from([SR4000, SR2B]),
    period=st.floats(0.02, 0.1),
    ahead=st.floats(0, 1),
    settle=st.sampled_from([0.0, 0.02, 0.1]),
)
@settings(max_examples=25, deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate))
def test_no_frame_from_before_a_movement_is_given_to_the_pose_after_it(camera, faults, period, ahead, settle):
    if camera is SR2B:
        period = 4 * 10e-3
    bench = Bench(faults, period, ahead * period, settle, camera)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discovery, "libusb", lambda: bench.stand_in)
        found = bench.scan()
    assert len(found) == BURSTS * POSES
    for exposure in found:
        bench.check(*exposure)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("trigger", [1, 2, 3, 5])
def test_one_fault_gives_no_frame_to_another_pose(fault, trigger):
    bench = Bench({trigger: fault}, 0.03, 0.0, 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discovery, "libusb", lambda: bench.stand_in)
        for exposure in bench.scan():
            bench.check(*exposure)


@pytest.fixture(scope="module")
def stub(tmp_path_factory):
    """The stub of the vendor's library, compiled."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    path = tmp_path_factory.mktemp("stub") / "libmesasr.so"
    source = Path(__file__).parents[1] / "drivers" / "mesasr_stub.c"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", path, source, "-lm"], check=True)
    return path


@given(
    faults=st.dictionaries(st.integers(1, 24), st.integers(1, 3), max_size=8),
    mode=st.sampled_from([0x501, 0x101]),
    settle=st.sampled_from([0.0, 0.02]),
)
@settings(max_examples=40, deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate))
def test_no_earlier_frame_comes_through_the_vendor_s_library(stub, faults, mode, settle):
    levers = ctypes.CDLL(str(stub))
    levers.stub_last_began.restype = ctypes.c_int64
    levers.stub_clear_faults()
    for number, kind in faults.items():
        levers.stub_fault(number, kind)
    clock = StubClock(levers)
    stage = LoggedStage(clock)
    camera = MesaCamera(MesaCamera.Options(library=stub, acquire_mode=mode), clock)
    rig = Rig(camera, stage, clock, calibration=sr4000_calibration())
    rig.open()
    began: list[int] = []
    grabber = Grabber(rig, 0.3, Control(Event()), lambda _: began.append(levers.stub_last_began()))
    plan = make_plan(PlanSection(), POSES, rig.calibration.intrinsics)
    capture = Capture(grabber, ScanBursts(grabber, plan, settle, 10.0))
    for burst, _ in zip(capture.run(), range(BURSTS), strict=False):
        assert [frame.pose for frame in burst.frames] == list(range(POSES))
    rig.close()
    # each frame that was kept was exposed after the movement before it; of those given up nothing is asked
    assert len(began) >= BURSTS * POSES
    for exposure in began:
        _, arrived, _ = [move for move in stage.log if move[0] <= exposure][-1]
        assert arrived + round(settle * 1e9) <= exposure
        ended = exposure + 40_000_000
        assert all(start >= ended for start, _, _ in stage.log if start > exposure)
