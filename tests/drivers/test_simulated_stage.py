"""The simulated stage: steps, speed, pointing errors, and where it was at any time."""

import numpy as np
import pytest

from drivers import LimitError, Position, make_stage
from drivers.clock import VirtualClock

START = 1_700_000_000 * 10**9
STEP = np.radians(0.01)


def stage_of(**options):
    stage = make_stage("simulated", options, VirtualClock(START))
    stage.open()
    return stage


def test_it_starts_at_zero_without_error():
    stage = stage_of()
    assert stage.position == stage.pose_at(stage.clock.now()) == Position(0.0, 0.0)


def test_it_stops_at_whole_steps_and_reports_them():
    stage = stage_of()
    stage.move_to(0.01234, -0.00777)
    stage.wait()
    pan, tilt = stage.position.pan / STEP, stage.position.tilt / STEP
    assert (pan, tilt) == (pytest.approx(round(0.01234 / STEP)), pytest.approx(round(-0.00777 / STEP)))


def test_what_it_misses_by_has_the_stated_spread_and_is_not_reported():
    stage = stage_of(pointing_error=0.003)
    errors = []
    for k in range(400):
        stage.move_to(0.001 * (k % 7 + 1), 0.002 * (k % 5 + 1))
        stage.wait()
        true, reported = stage.pose_at(stage.clock.now()), stage.position
        if k:
            errors.append((true.pan - reported.pan, true.tilt - reported.tilt))
    spread = np.degrees(np.std(errors, axis=0))
    np.testing.assert_allclose(spread, 0.003, rtol=0.12)
    assert np.abs(np.mean(errors, axis=0)).max() < np.radians(0.0006)


def test_errors_repeat_with_the_seed_after_every_opening():
    def run(stage):
        seen = []
        for target in (0.01, 0.02, -0.01):
            stage.move_to(target, target)
            stage.wait()
            seen.append(stage.pose_at(stage.clock.now()))
        return seen

    stage, other = stage_of(seed=5), stage_of(seed=6)
    first = run(stage)
    stage.close()
    stage.open()
    assert run(stage) == first
    assert run(other) != first


def test_going_where_it_already_is_moves_nothing():
    stage = stage_of()
    stage.move_to(0.02, 0.01)
    stage.wait()
    before, time = stage.pose_at(stage.clock.now()), stage.clock.now()
    stage.move_to(0.02, 0.01)
    stage.wait()
    assert (stage.pose_at(stage.clock.now()), stage.clock.now()) == (before, time)


def test_it_moves_at_its_speed_and_knows_where_it_was():
    stage = stage_of(speed=10, resolution=0, pointing_error=0)
    begin = stage.clock.now()
    stage.move_to(np.radians(5), np.radians(-2))
    stage.wait()
    assert stage.clock.now() - begin == 500_000_000
    middle = stage.pose_at(begin + 100_000_000)
    assert np.degrees([middle.pan, middle.tilt]) == pytest.approx([1.0, -1.0])
    late = stage.pose_at(begin + 300_000_000)
    assert np.degrees([late.pan, late.tilt]) == pytest.approx([3.0, -2.0])
    assert stage.pose_at(begin - 1) == Position(0.0, 0.0)


def test_a_new_target_on_the_way_is_approached_from_where_it_is():
    stage = stage_of(speed=10, resolution=0, pointing_error=0)
    stage.move_to(np.radians(5), 0.0)
    stage.clock.sleep(0.2)
    assert np.degrees(stage.position.pan) == pytest.approx(2.0)
    stage.move_to(0.0, 0.0)
    stage.wait()
    assert stage.clock.now() - START == 400_000_000
    assert stage.position == Position(0.0, 0.0)


def test_it_is_stopped_on_its_way_and_stays_there():
    stage = stage_of(speed=10, resolution=0)
    stage.move_to(np.radians(5), 0.0)
    stage.clock.sleep(0.2)
    stage.stop()
    stage.clock.sleep(1.0)
    stage.wait()
    assert np.degrees(stage.position.pan) == pytest.approx(2.0)


def test_home_finds_zero_without_error():
    stage = stage_of(pointing_error=0.1)
    stage.move_to(0.1, 0.1)
    stage.wait()
    assert stage.pose_at(stage.clock.now()) != stage.position
    stage.home()
    assert stage.pose_at(stage.clock.now()) == Position(0.0, 0.0)


def test_angles_beyond_the_limits_are_refused():
    stage = stage_of()
    with pytest.raises(LimitError, match=r"tilt 40\.000°"):
        stage.move_to(0.0, np.radians(40))
    assert stage.position == Position(0.0, 0.0)
