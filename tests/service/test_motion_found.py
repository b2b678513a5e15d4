"""What the images of a burst say of the stage, against where it really turned."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.backends import make_camera
from drivers.clock import VirtualClock
from drivers.position import Position
from drivers.simulation.stage import SimulatedStage, StageOptions
from service.config.sections import FusionSection, PlanSection
from service.daemon.motion_watch import MotionWatch
from service.daemon.states import States
from service.fusion.fuse import fuse_burst
from service.messages.burst import Burst
from service.messages.report import BurstReport
from service.planning.plan import make_plan

POSES = 8
SETTINGS = FusionSection(method="nearest", upsampling=2, frames=POSES)

pytestmark = pytest.mark.slow


class LyingStage(SimulatedStage):
    """Reports what it was told, and turns its head as `gains` (pan, tilt) say."""

    gains = 1.0, 1.0

    def pose_at(self, timestamp: int) -> Position:
        true = super().pose_at(timestamp)
        return Position(self.gains[0] * true.pan, self.gains[1] * true.tilt)


def report_of(scene: str, gains: tuple[float, float], span: float = 1.0) -> BurstReport:
    """How the fusion of a burst went whose stage lied."""
    clock = VirtualClock(1_700_000_000_000_000_000)
    stage = LyingStage(StageOptions(speed=1000.0), clock)
    stage.gains = gains
    camera = make_camera("simulated", {"scene": scene}, clock)
    stage.open()
    camera.mount_on(stage)
    with camera:
        camera.start()
        plan = make_plan(PlanSection(span=span), POSES, camera.calibration.intrinsics, resolution=1e-5)
        frames = []
        for number, pose in enumerate(plan.poses):
            stage.move_to(pose.pan, pose.tilt)
            stage.wait(10.0)
            arrived = clock.now()
            while camera.exposure_start(frame := camera.grab(2.0)) < arrived:
                continue
            here = stage.position
            frames.append(replace(frame, pan=here.pan, tilt=here.tilt, burst=0, pose=number))
        burst = Burst(0, tuple(frames), camera.calibration, POSES)
    return fuse_burst(burst, SETTINGS).report


def words(report: BurstReport) -> list[str]:
    states = States()
    MotionWatch(states).note(report)
    return [fault.what for fault in states.degraded]


@pytest.mark.parametrize(
    ("span", "gains", "said"),
    [
        (1.0, (1.0, 1.0), []),
        (8.0, (1.0, 1.0), []),
        (8.0, (0.0, 0.0), ["pan, but the images show no motion", "tilt, but the images show no motion"]),
        (1.0, (0.0, 1.0), ["pan, but the images show no motion"]),
        (8.0, (1.0, -1.0), ["tilt, but the images show that it turns the wrong way"]),
        (2.0, (2.0, 2.0), ["pan, but the images show 2.0 times", "tilt, but the images show 2.0 times"]),
    ],
)
def test_a_scene_with_texture_shows_how_far_the_stage_turned(
    span: float, gains: tuple[float, float], said: list[str]
) -> None:
    report = report_of("wedges", gains, span)
    assert report.motion is not None
    assert report.motion.pan is not None
    assert report.motion.tilt is not None
    np.testing.assert_allclose([report.motion.pan.gain, report.motion.tilt.gain], gains, atol=0.1)
    found = "; ".join(words(report))
    assert all(one in found for one in said), found
    assert bool(found) == bool(said)


@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.0, 0.0)])
def test_a_wall_without_texture_is_not_judged(gains: tuple[float, float]) -> None:
    assert words(report_of("plane", gains)) == []


def test_a_stage_that_stands_still_on_purpose_is_not_judged() -> None:
    assert report_of("wedges", (1.0, 1.0), 0.0).motion is None
