"""Bursts by a plan, through faults of the devices."""

from threading import Event

import pytest
from capture_scene import SETTLE, FrozenStage, Scene
from scripted import PERIOD, ScriptedStage, frame

from drivers import (
    CameraSettings,
    DeviceLostError,
    DeviceTimeoutError,
    Frame,
    LimitError,
    NotAvailableError,
    OperationError,
)
from drivers.clock import VirtualClock
from drivers.simulated import SimulatedCamera
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.rig import Rig
from service.capture.scan import ScanBursts
from service.capture.series import Capture
from service.config.sections import PlanSection
from service.errors import MotionError
from service.planning.plan import make_plan


def test_each_pose_is_reached_settled_and_stamped_with_the_reported_angles() -> None:
    scene = Scene()
    (burst,) = scene.take(1)
    assert scene.stage.moves == [(p.pan, p.tilt) for p in scene.plan.poses]
    assert [(f.burst, f.pose) for f in burst.frames] == [(0, k) for k in range(5)]
    for shown, (pan, tilt) in zip(burst.frames, scene.stage.moves, strict=True):
        assert (shown.pan, shown.tilt) == (pan + 1e-5, tilt)
    assert scene.shown == list(burst.frames)
    assert burst.missing == 0


def test_no_frame_was_exposed_before_the_stage_stood_still() -> None:
    scene = Scene()
    settled = []
    wait = scene.stage.wait

    def observed(timeout: float) -> None:
        wait(timeout)
        settled.append(scene.clock.now() + round(SETTLE * 1e9))

    scene.stage.wait = observed  # type: ignore[method-assign]
    (burst,) = scene.take(1)
    assert all(scene.camera.exposure_start(f) >= at for f, at in zip(burst.frames, settled, strict=True))
    assert scene.counts.stale > 0, "the camera ran while the stage moved, so some frames must have been stale"
    assert scene.counts.dropped == 0, "frames that pass while the stage moves are nobody's loss"


def test_where_nothing_moves_nothing_is_stale() -> None:
    scene = Scene()
    scene.plan.offsets[:] = 0
    scene.take(3)
    assert len(scene.stage.moves) == 1
    assert scene.counts.frames == 15
    assert scene.counts.stale == 3, "only what came while the stage was sent there"


def test_a_stage_that_was_moved_meanwhile_is_sent_back() -> None:
    scene = Scene()
    scene.plan.offsets[:] = 0
    scene.take(1)
    scene.stage._move_to(0.1, 0.0)
    scene.take(1)
    assert len(scene.stage.moves) == 3


def test_frames_that_pass_in_a_pause_between_bursts_are_nobodys_loss() -> None:
    clock = VirtualClock(1_000_000_000)
    rig = Rig(SimulatedCamera(clock=clock), ScriptedStage(clock), clock)
    rig.open()
    plan = make_plan(PlanSection(), 3, rig.calibration.intrinsics)
    plan.offsets[:] = 0
    grabber = Grabber(rig, 2.0, Control(Event()))
    bursts = Capture(
        grabber, ScanBursts(grabber, plan, SETTLE, 10.0), pause=lambda elapsed: 2.0 - elapsed
    ).run()
    first, second = next(bursts), next(bursts)
    assert second.frames[0].sequence - first.frames[-1].sequence > 5, "frames must have passed"
    assert grabber.counts.dropped == 0


def test_a_pause_lasts_as_long_as_is_said_while_it_lasts() -> None:
    scene = Scene()
    asked: list[float] = []

    def pause(elapsed: float) -> float:
        asked.append(elapsed)
        return 0.0 if elapsed >= 0.3 else 5.0

    capture = Capture(scene.grabber, ScanBursts(scene.grabber, scene.plan, SETTLE, 10.0), pause=pause).run()
    next(capture)
    done = scene.clock.now()
    second = next(capture)
    assert asked == pytest.approx([0.05 * k for k in range(7)])
    assert second.frames[0].timestamp - done >= 300_000_000


def test_an_unknown_integration_time_is_taken_as_the_longest() -> None:
    scene = Scene()
    unknown = frame(0, 10**9, integration_time=None, timestamp_uncertainty=10**6)
    assert scene.camera.exposure_start(unknown) == 10**9 - 10**6 - 2 * 10**8


def test_bursts_follow_one_another() -> None:
    bursts = Scene().take(3)
    assert [b.id for b in bursts] == [0, 1, 2]
    assert [f.burst for b in bursts for f in b.frames] == [0] * 5 + [1] * 5 + [2] * 5


def test_a_garbled_frame_is_tried_again() -> None:
    scene = Scene(camera_faults={3: OperationError("short frame"), 4: DeviceTimeoutError("no frame in 2 s")})
    (burst,) = scene.take(1)
    assert len(burst.frames) == 5
    assert scene.counts.faults == 2
    assert scene.counts.interrupted == scene.rig.reopened == 0
    assert scene.counts.error == ""  # it is over


def test_a_lost_camera_is_opened_again_and_the_burst_taken_anew() -> None:
    settings = CameraSettings(integration_time=0.02)
    scene = Scene(camera_faults={6: DeviceLostError("unplugged")}, settings=settings)
    (burst,) = scene.take(1)
    assert [f.pose for f in burst.frames] == list(range(5))
    assert scene.camera.opened == 2
    assert scene.camera.applied == [settings, settings]
    assert (scene.counts.lost, scene.counts.interrupted, scene.rig.reopened) == (1, 1, 1)
    assert {f.burst for f in burst.frames} == {0}


def test_waits_grow_until_the_camera_is_back() -> None:
    scene = Scene(camera_faults={2: DeviceLostError("unplugged")})
    scene.camera.refusals = [NotAvailableError("not there") for _ in range(3)]
    before = scene.clock.now()
    scene.take(1)
    # 0.5 + 1 + 2 s between the attempts, then a burst of five frames.
    assert 3.5 < (scene.clock.now() - before) / 1e9 < 10
    assert scene.rig.reopened == 1


def test_a_fault_that_stays_is_a_lost_device() -> None:
    faults = {call: OperationError("garbled") for call in range(2, 6)}
    scene = Scene(camera_faults=faults)
    scene.take(1)
    assert scene.counts.faults == 4
    assert scene.counts.lost == 1


FINAL = [DeviceTimeoutError("still moving"), OperationError("refused"), LimitError("ran into its limit")]


@pytest.mark.parametrize("fault", FINAL, ids=lambda fault: type(fault).__name__)
def test_after_a_failed_movement_nothing_moves_by_itself(fault: Exception) -> None:
    scene = Scene(stage_faults={2: fault})
    with pytest.raises(MotionError, match=f"{fault}; it stands still until started again"):
        scene.take(1)
    assert (len(scene.stage.moves), scene.stage.homings, scene.rig.reopened) == (3, 0, 0)
    assert scene.stage.stops == 1


def test_a_frame_that_is_tried_again_moves_nothing() -> None:
    scene = Scene(camera_faults={2: OperationError("garbled")})
    scene.take(1)
    assert len(scene.stage.moves) == 5


def test_a_lost_camera_stops_the_stage_and_leaves_it_open() -> None:
    scene = Scene(camera_faults={6: DeviceLostError("unplugged")})
    opened = []
    scene.stage._open = lambda: opened.append(True)  # type: ignore[method-assign]
    scene.take(1)
    assert scene.stage.stops == 1
    assert opened == [], "many stages forget where they are when they are opened"


def test_told_to_stop_in_the_middle_of_a_movement_it_stops_the_stage() -> None:
    scene = Scene()
    after = scene.clock.now() + 100_000_000
    scene.stage.interrupted = lambda: scene.clock.now() > after
    assert scene.take(1) == []
    assert scene.stage.stops == 1
    assert scene.clock.now() - after < 0.2e9


def test_a_lost_stage_interrupts_the_burst() -> None:
    scene = Scene(stage_faults={2: DeviceLostError("no answer")})
    (burst,) = scene.take(1)
    assert len(burst.frames) == 5
    assert scene.counts.interrupted == 1


def test_gaps_in_the_numbers_are_drops() -> None:
    scene = Scene()
    scene.plan.offsets[:] = 0
    scene.camera.skip = 2
    scene.take(1)
    assert scene.counts.dropped == 2 * (scene.counts.frames - 1 + scene.counts.stale)


def test_frames_that_stay_too_old_are_an_error_with_a_reason() -> None:
    scene = Scene()
    grab = scene.camera._grab

    def late(timeout: float) -> Frame:
        found = grab(timeout)
        return frame(found.sequence, found.timestamp - 3600 * 10**9)

    scene.camera._grab = late  # type: ignore[method-assign]
    with pytest.raises(OperationError, match="check the camera's timestamps"):
        scene.capture._source.take(0)


def test_stopping_ends_in_the_middle_of_a_burst() -> None:
    scene = Scene()
    scene.grabber._listener = lambda _: scene.stop.set()
    assert scene.take(1) == []
    assert scene.counts.frames == 1


def test_stopping_ends_the_wait_for_a_lost_camera() -> None:
    scene = Scene(camera_faults={2: DeviceLostError("unplugged")})

    class Gone(list):
        def pop(self, _index: int = -1) -> Exception:
            scene.stop.set()
            return NotAvailableError("not there")

        def __bool__(self) -> bool:
            return True

    scene.camera.refusals = Gone()
    assert scene.take(1) == []


class SetClock(VirtualClock):
    """One that somebody sets."""

    moved = 0

    def correction(self) -> int:
        return self.moved


@pytest.mark.parametrize("moved", [-3600, 86_400])
def test_a_clock_that_is_set_stamps_the_next_burst_and_disturbs_none(moved: int, monkeypatch) -> None:
    monkeypatch.setattr("capture_scene.VirtualClock", SetClock)
    scene = Scene()
    assert isinstance(scene.clock, SetClock)
    bursts = scene.capture.run()
    before = next(bursts)
    scene.clock.moved = moved * 10**9
    after, later = next(bursts), next(bursts)
    times = [[f.timestamp for f in burst.frames] for burst in (before, after, later)]
    apart = (times[1][0] - times[0][-1] - moved * 10**9) / 1e9
    assert 0 < apart < 2
    assert 0 < (times[2][0] - times[1][-1]) / 1e9 < 2
    for burst in times:
        assert 0 < (burst[-1] - burst[0]) / 1e9 < 5
    assert scene.counts.stale < 60
    assert scene.counts.faults == 0


def test_a_long_movement_and_a_long_recorded_pause_are_signs_of_life() -> None:
    scene = Scene()
    scene.take(1)
    moving = scene.rig.beats
    assert moving >= 4
    silent = Scene(
        carried=[frame(k, k * PERIOD, burst=0, pose=k) for k in range(3)],
        camera_faults={call: DeviceTimeoutError("none yet") for call in range(1, 21)},
    )
    silent.take(1)
    assert silent.rig.beats >= 20


def test_a_stage_that_always_reports_0_is_told_within_one_burst() -> None:
    scene = Scene(kind=FrozenStage)
    with pytest.raises(MotionError, match=r"was sent to pan -0\.\d+° to 0\.\d+° .* but reports 0\.000° to 0"):
        scene.take(1)
    assert len(scene.shown) == 5
