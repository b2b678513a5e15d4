"""When a simulated frame is computed: while it is exposed, and to the same bits as afterwards."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain, repeat

import numpy as np
import pytest

import drivers.simulated
from drivers import Frame, make_camera, make_stage
from drivers.camera import Camera
from drivers.clock import VirtualClock
from drivers.settings import CameraSettings
from drivers.stage import Stage

START = 1_700_000_000 * 10**9
PERIOD = 20_000_000
FAST = CameraSettings(integration_time=0.00475, frame_rate=50)

pytestmark = pytest.mark.usefixtures("rendered_once")


class EventfulClock(VirtualClock):
    """A virtual clock during whose next sleep something happens."""

    def __init__(self) -> None:
        super().__init__(START)
        self.meanwhile: Callable[[], None] = lambda: None

    def sleep(self, seconds: float) -> None:
        meanwhile, self.meanwhile = self.meanwhile, lambda: None
        meanwhile()
        super().sleep(seconds)


@contextmanager
def rig(scene: str = "plane") -> Iterator[tuple[Camera, Stage, EventfulClock]]:
    """A camera at 50 frames/s, started, on a stage at rest."""
    clock = EventfulClock()
    stage = make_stage("simulated", {"speed": 5}, clock)
    camera = make_camera("simulated", {"scene": scene}, clock)
    camera.mount_on(stage)
    with stage, camera:
        camera.settings = FAST
        camera.start()
        yield camera, stage, clock


@pytest.fixture
def computing(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[int]]:
    """Has one frame after the other take so many seconds of a clock to compute, all later ones as many as the
    last; gives when each began."""

    def slow(clock: VirtualClock, *seconds: float) -> list[int]:
        began: list[int] = []
        taken, expose = chain(seconds, repeat(seconds[-1])), drivers.simulated.expose

        def exposed(*arguments: object) -> object:
            began.append(clock.now())
            VirtualClock.sleep(clock, next(taken))
            return expose(*arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(drivers.simulated, "expose", exposed)
        return began

    return slow


def assert_same(a: Frame, b: Frame) -> None:
    assert (a.sequence, a.timestamp) == (b.sequence, b.timestamp)
    np.testing.assert_array_equal(a.counts, b.counts)
    assert a.amplitude is not None
    np.testing.assert_array_equal(a.amplitude, b.amplitude)


def test_a_frame_is_computed_once_before_its_exposure_ends(computing):
    with rig() as (camera, _, clock):
        began = computing(clock, 0.018)
        frames = [camera.grab() for _ in range(20)]
        assert [frame.sequence for frame in frames] == list(range(20))
        assert began == [START + PERIOD * number for number in range(20)]
        assert clock.now() == START + 20 * PERIOD


@pytest.mark.parametrize("seconds", [0.030, 0.090])
def test_nobody_loses_a_frame_over_one_that_took_long_to_compute(computing, seconds):
    with rig() as (camera, _, clock):
        clock.sleep(0.035)
        computing(clock, seconds, 0.0)
        assert [camera.grab().sequence for _ in range(8)] == list(range(8))


def test_nobody_loses_a_frame_over_one_that_was_computed_anew(computing):
    with rig() as (camera, stage, clock):
        camera.grab()
        computing(clock, 0.0, 0.090, 0.0)
        clock.meanwhile = lambda: stage.move_to(0.05, 0.0)
        first = camera.grab().sequence
        assert [camera.grab().sequence for _ in range(6)] == [first + 1 + k for k in range(6)]


def test_a_computer_that_is_too_slow_all_along_loses_frames(computing):
    with rig() as (camera, _, clock):
        computing(clock, 0.050)
        assert [camera.grab().sequence for _ in range(5)] == [0, 1, 2, 4, 6]


def test_a_caller_who_is_too_slow_loses_frames_however_long_they_took_to_compute(computing):
    with rig() as (camera, _, clock):
        computing(clock, 0.015)
        assert camera.grab().sequence == 0
        clock.sleep(0.045)
        assert camera.grab().sequence == 2


def test_frames_are_the_same_waited_for_or_fetched_late():
    with rig("step") as (prompt, stage, _), rig("step") as (late, other, clock):
        for turn in (0.0, 0.05, -0.05, 0.0):
            for one in (stage, other):
                one.move_to(turn, 0.0)
            for _ in range(3):
                clock.sleep(PERIOD * 1e-9)
                frame = late.grab()
                assert clock.now() == frame.timestamp + PERIOD // 2
                assert_same(prompt.grab(), frame)


def test_a_frame_shows_what_moved_the_stage_during_its_exposure():
    with (
        rig("step") as (disturbed, stage, clock),
        rig("step") as (known, other, _),
        rig("step") as (undisturbed, _, _),
    ):
        assert_same(disturbed.grab(), known.grab())
        undisturbed.grab()
        clock.meanwhile = lambda: stage.move_to(0.05, 0.0)
        other.move_to(0.05, 0.0)
        moved = disturbed.grab()
        assert_same(moved, known.grab())
        assert np.mean(moved.counts != undisturbed.grab().counts) > 0.5
