"""The pan-tilt unit: what it is told, and when it must not move."""

import re
from math import degrees, radians

import pytest
from emulators.ptu_emulator import COUNT, PtuEmulator
from ptu_bench import Bench

from drivers.backends import make_stage
from drivers.errors import (
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    StateError,
)

FORBIDDEN = re.compile(r"D[SRF]|U.*|_.*|LD|A|M.*|RD|CV|S")
"""What writes the EEPROM, lets limits go, cannot be halted, or moves by itself."""


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def stage(bench):
    return bench.open()


def keep_asking(stage):
    while True:
        _ = stage.position


def test_learns_resolution_and_limits_from_the_unit(stage):
    limits = stage.limits
    assert limits.pan == pytest.approx((-3090 * COUNT, 3090 * COUNT))
    assert limits.tilt == pytest.approx((-907 * COUNT, 604 * COUNT))
    assert stage.resolution == pytest.approx(COUNT)


def test_is_made_slow_before_it_can_move(bench, stage):
    assert [bench.unit.axes[axis].speed for axis in "PT"] == [194, 194]
    assert bench.unit.acceleration == {"P": 388, "T": 388}
    assert degrees(stage.speed) == pytest.approx(9.977, abs=0.001)
    assert bench.unit.moves == []


def test_speed_is_put_in_force_again_before_each_move(bench, stage):
    bench.unit.axes["P"].speed = 2900
    stage.move_to(radians(5), 0.0)
    assert bench.unit.axes["P"].speed == 194


def test_an_acceleration_that_is_gentler_already_is_left(bench):
    bench.open(acceleration=1000)
    assert bench.unit.acceleration == {"P": 2000, "T": 2000}


def test_a_speed_below_the_units_own_bound_is_refused(bench):
    with pytest.raises(InitialisationError, match=r"cannot turn as slowly as 1°/s; its slowest is 1\.594°/s"):
        bench.open(speed=1.0)


def test_a_speed_beyond_the_units_own_bound_is_the_bound():
    bench = Bench(fastest=2902)
    stage = bench.open(speed=360)
    assert degrees(stage.speed) == pytest.approx(2902 * degrees(COUNT))


def test_limits_that_were_let_go_are_enforced_again(bench):
    bench.unit.limits_enforced = False
    bench.open()
    assert bench.unit.limits_enforced


def test_a_unit_that_does_not_enforce_its_limits_is_refused(bench):
    bench.unit._set_mode = lambda command: None  # noqa: ARG005
    bench.unit.limits_enforced, bench.unit.echo = False, False
    with pytest.raises(InitialisationError, match="does not enforce its limits"):
        bench.open()


def test_moves_to_the_nearest_positions_and_confirms_them(bench, stage):
    stage.move_to(1000.4 * COUNT, -9.6 * COUNT)
    stage.wait()
    assert "PP1000" in bench.unit.commands
    assert "TP-10" in bench.unit.commands
    assert stage.position.pan == pytest.approx(1000 * COUNT)  # positive: to the left
    assert stage.position.tilt == pytest.approx(-10 * COUNT)


def test_accepts_a_unit_that_always_echoes(bench):
    mode = bench.unit._set_mode
    bench.unit._set_mode = lambda command: mode(command) if command != "ED" else None
    stage = bench.open()
    stage.move_to(1000 * COUNT, -10 * COUNT)
    stage.wait()
    assert stage.position.pan == pytest.approx(1000 * COUNT)


def test_a_halt_leaves_it_where_it_is_and_known(bench, stage):
    stage.move_to(radians(30), radians(-20))
    bench.clock.sleep(1.0)
    stage.stop()
    assert not bench.unit.moving
    here = bench.unit.true_angles
    assert 9 < degrees(here[0]) < 12
    bench.clock.sleep(3.0)
    assert (stage.position.pan, stage.position.tilt) == pytest.approx(here, abs=COUNT / 2)


def test_homing_turns_both_axes_even_where_resetting_was_switched_off(bench, stage):
    bench.unit.resets_axes = False
    bench.unit.slipped["P"] = 50
    stage.home()
    assert bench.unit.true_angles == (0.0, 0.0)


def test_homing_without_an_end(bench):
    stage = bench.open(home_timeout=5.0)
    bench.unit._reset = lambda: None
    with pytest.raises(DeviceTimeoutError, match="no end of the calibration move within 5 s"):
        stage.home()
    assert stage.needs_home


def test_an_autoscan_that_opening_ends_does_not_send_the_head_home(bench):
    bench.unit.autoscan()
    bench.clock.sleep(1.5)
    before = bench.unit.true_angles[0]
    stage = bench.open()
    bench.clock.sleep(5.0)
    assert bench.unit.true_angles[0] == pytest.approx(before, abs=radians(0.1))
    assert "moved when it was opened" in stage.uncertainty
    with pytest.raises(StateError, match="an autoscan, or another program"):
        stage.move_to(0.0, 0.0)
    stage.home()
    assert stage.uncertainty is None


@pytest.mark.parametrize("manner", ["as delivered", "as this driver leaves it", "terse"])
def test_a_head_at_rest_is_not_taken_for_a_moving_one(bench, manner):
    bench.unit.echo, bench.unit.verbose = manner == "as delivered", manner != "terse"
    bench.unit.axes["P"].set(700)
    assert bench.open().uncertainty is None


def test_a_head_that_has_been_turned_on_is_not_turned_back(bench, stage):
    bench.unit.axes["P"].set(7000)  # 360°: the unit's limits were let go, and a slip ring let it
    with pytest.raises(LimitError, match=r"reports that pan 360\.000°"):
        stage.move_to(0.0, 0.0)
    assert bench.unit.moves == []
    assert stage.needs_home


def test_waits_for_a_unit_that_calibrates_itself():
    bench = Bench(boot_seconds=20.0)
    bench.unit.power_cycle()
    assert bench.open().position.pan == 0


def test_emulated_unit_end_to_end():
    options = {"speed": 360, "acceleration": 3600}
    with PtuEmulator() as emulator, make_stage("ptu", {"port": emulator.port, **options}) as stage:
        stage.move_to(radians(10), radians(-5))
        stage.wait()
        assert stage.position.pan == pytest.approx(radians(10), abs=COUNT / 2)
        assert stage.position.tilt == pytest.approx(radians(-5), abs=COUNT / 2)
        emulator.run_into_limit("T")
        with pytest.raises(LimitError):
            keep_asking(stage)
        assert "R" not in emulator.commands
        stage.home()
        assert stage.position.pan == 0
        assert not [command for command in emulator.commands if FORBIDDEN.fullmatch(command)]
