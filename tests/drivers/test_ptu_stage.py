"""The pan-tilt unit: what it is told, how it is understood over a bad line, and when it must not move."""

import re
from math import degrees, radians
from unittest.mock import patch

import pytest
from emulators.ptu_emulator import COUNT, LIMITS, PtuEmulator
from emulators.virtual_line import Fault, VirtualLine

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    NotAvailableError,
    OperationError,
    StateError,
)

FORBIDDEN = re.compile(r"D[SRF]|U.*|_.*|LD|A|M.*|RD|CV|S")
"""What writes the EEPROM, lets limits go, cannot be halted, or moves by itself."""


class Bench:
    """A unit on a line in virtual time."""

    def __init__(self, **unit):
        self.clock = VirtualClock(10**9)
        self.unit = PtuEmulator(**unit)
        self.line = VirtualLine(self.unit, self.clock, {})
        self.stage = None

    def open(self, **options):
        self.stage = make_stage("ptu", {"port": "virtual", **options}, self.clock)
        with patch("serial.serial_for_url", self.line.open):
            self.stage.open()
        return self.stage

    def reopen(self):
        self.stage.close()
        with patch("serial.serial_for_url", self.line.open):
            self.stage.open()

    def next_answers(self, *faults):
        """What becomes of the answers that come next."""
        for number, fault in enumerate(faults):
            self.line.faults[self.line.answers + number] = fault


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def stage(bench):
    return bench.open()


def garbled(*pieces):
    return Fault("garbled", pieces=pieces)


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


@pytest.mark.parametrize(
    "fault",
    [
        garbled(b"* Current Pan position is 1000\r"),
        garbled(b"*", b" Current Pan", b" position is 10", b"00", b"\r\n"),
        garbled(b"\xff\x00 ~*\x81\xfe* Current Pan position is 1000\r\n"),
        garbled(b"*\r\n* Current Pan position is 1000\r\n"),
        garbled(b"* 777\r\n* Current Tilt position is 5\r\n* Current Pan position is 1000\r\n"),
        garbled(b"* Current Pan position is 10\x8100\r\n"),
        garbled(b"* Current Pan position is 100\r\n"),
        garbled(b"!\r\n"),
        Fault("lost"),
        Fault("late", 0.9),
        Fault("late", 1.16),
        Fault("late", 2.5),
    ],
)
def test_reads_a_position_over_a_bad_line(bench, stage, fault):
    bench.unit.axes["P"].set(1000)
    bench.unit.axes["T"].set(-3)
    bench.next_answers(fault)
    for _ in range(3):
        position = stage.position
        assert (position.pan, position.tilt) == pytest.approx((1000 * COUNT, -3 * COUNT))


def test_the_line_stalls_and_no_axis_is_given_the_others_angle(bench, stage):
    stage.move_to(0.06, 0.01)
    stage.wait()
    for number in range(12):
        bench.next_answers(Fault("late", 1.16 if number % 2 else 0.0))
        angles = stage.position
        assert (degrees(angles.pan), degrees(angles.tilt)) == pytest.approx((3.45, 0.57), abs=0.01)


@pytest.mark.parametrize("lateness", [0.5, 1.5])
def test_a_late_answer_is_no_acknowledgement(bench, stage, lateness):
    """The head has to be where it is said to be, whatever came between."""
    bench.next_answers(*[Fault("late", lateness)] * 2)
    _ = stage.position
    stage.move_to(radians(5), radians(2))
    stage.wait()
    assert stage.position.pan == pytest.approx(bench.unit.true_angles[0])
    assert degrees(bench.unit.true_angles[0]) == pytest.approx(5, abs=0.05)


def test_an_old_answer_to_the_same_query_is_no_arrival():
    """There and back again, while what was said at the start is said once more, some time later."""
    for hundredths in range(30, 130):
        bench = Bench()
        stage = bench.open()
        bench.next_answers(Fault("late"), Fault("late"), Fault("late"), Fault("twice", hundredths / 100))
        _ = stage.position
        for tilt in (radians(3), 0.0):
            stage.move_to(0.0, tilt)
            stage.wait()
            assert not bench.unit.moving, f"doubled after {hundredths / 100} s"
            assert bench.unit.true_angles[1] == pytest.approx(tilt, abs=COUNT / 2)


def test_accepts_a_unit_that_always_echoes(bench):
    mode = bench.unit._set_mode
    bench.unit._set_mode = lambda command: mode(command) if command != "ED" else None
    stage = bench.open()
    stage.move_to(1000 * COUNT, -10 * COUNT)
    stage.wait()
    assert stage.position.pan == pytest.approx(1000 * COUNT)


def test_a_blocked_head_is_halted_when_time_is_up(bench, stage):
    stage.move_to(radians(20), 0.0)
    bench.unit.axes["P"].stop()
    halts = len(bench.unit.halts)
    with pytest.raises(DeviceTimeoutError, match="check that nothing blocks it"):
        stage.wait(2.0)
    assert len(bench.unit.halts) > halts
    assert not stage.needs_home, "its position is still known"


def test_a_halt_leaves_it_where_it_is_and_known(bench, stage):
    stage.move_to(radians(30), radians(-20))
    bench.clock.sleep(1.0)
    stage.stop()
    assert not bench.unit.moving
    here = bench.unit.true_angles
    assert 9 < degrees(here[0]) < 12
    bench.clock.sleep(3.0)
    assert (stage.position.pan, stage.position.tilt) == pytest.approx(here, abs=COUNT / 2)


def test_a_command_that_is_garbled_on_its_way_is_halted_at_the_hosts_limit(bench):
    stage = bench.open(pan_limits=(-20, 20))
    move = bench.unit._move
    bench.unit._move = lambda axis, target: move(axis, 3000 if axis == "P" else target)
    stage.move_to(radians(15), 0.0)
    with pytest.raises(LimitError, match=r"reports that pan 2\d\.\d+° is outside"):
        stage.wait()
    assert not bench.unit.moving
    assert degrees(bench.unit.true_angles[0]) < 23
    assert stage.needs_home


def test_a_halt_that_is_lost_is_sent_again(bench, stage):
    execute, lost = bench.unit._execute, []

    def deaf_once(command):
        if command == "H" and not lost:
            lost.append(command)
            bench.unit.say(b"*\r\n")
        else:
            execute(command)

    bench.unit._execute = deaf_once
    stage.move_to(radians(30), 0.0)
    bench.clock.sleep(0.5)
    stage.stop()
    assert lost == ["H"]
    assert not bench.unit.moving


def test_a_unit_that_falls_silent_on_its_way_is_lost_and_halted(bench, stage):
    stage.move_to(1000 * COUNT, -10 * COUNT)
    bench.unit.mute = True
    with pytest.raises(DeviceLostError, match="does not answer"):
        stage.wait(60)
    assert not bench.unit.moving, "it hears the halt, although it says nothing"
    assert stage.needs_home
    with pytest.raises(StateError, match="its position is unknown"):
        _ = stage.position
    with pytest.raises(StateError, match="home it first"):
        stage.move_to(0.0, 0.0)


def test_limit_hit_on_the_way_makes_the_position_unknown_until_homed(bench, stage):
    stage.move_to(1000 * COUNT, -10 * COUNT)
    bench.clock.sleep(0.5)
    bench.unit.run_into_limit("P")
    with pytest.raises(LimitError, match="the pan axis hit a limit; steps are lost"):
        stage.wait()
    assert not bench.unit.moving, "the tilt axis is halted too"
    assert "pan axis hit a limit" in stage.uncertainty
    bench.reopen()
    assert stage.needs_home
    assert "R" not in bench.unit.commands, "nobody has consented"
    stage.home()
    assert not stage.needs_home
    assert (stage.position.pan, stage.position.tilt) == pytest.approx(bench.unit.true_angles)


def test_limit_hit_unasked_is_noticed_on_closing_too(bench, stage):
    bench.unit.run_into_limit("T")
    bench.clock.sleep(0.1)
    bench.reopen()
    assert "tilt axis hit a limit" in stage.uncertainty


def test_a_restart_that_nobody_saw_is_noticed_on_opening_again(bench, stage):
    bench.unit.axes["P"].set(500)
    bench.unit.lose_count()
    bench.reopen()
    assert "has restarted" in stage.uncertainty
    bench.reopen()
    assert stage.needs_home


def test_limit_hit_unasked_is_noticed_at_the_next_call(bench, stage):
    _ = stage.position
    bench.unit.run_into_limit("T")
    bench.clock.sleep(0.1)
    with pytest.raises(LimitError, match="tilt axis hit a limit"):
        _ = stage.position
    assert stage.needs_home


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


@pytest.mark.parametrize("failure", [PtuEmulator.power_cycle, PtuEmulator.lose_count])
def test_restart_is_recognised_by_its_echo_before_anything_is_sent_that_moves(bench, stage, failure):
    stage.move_to(radians(10), 0.0)
    stage.wait()
    failure(bench.unit)
    moves = len(bench.unit.moves)
    with pytest.raises(DeviceLostError, match="has restarted"):
        stage.move_to(radians(12), 0.0)
    assert len(bench.unit.moves) == moves
    assert stage.needs_home


def test_echo_seen_once_is_noise(bench, stage):
    bench.next_answers(garbled(b"PP * Current Pan position is 0\r\n"))
    assert stage.position.pan == 0
    assert not stage.needs_home


def test_refusal_is_reported_with_the_unit_s_words(bench, stage):
    refuse = bench.unit._move
    bench.unit._move = lambda *_: bench.unit.say(b"! Maximum allowable Pan position is 900\r\n")
    with pytest.raises(OperationError, match="Maximum allowable Pan position is 900"):
        stage.move_to(1000 * COUNT, 0.0)
    bench.unit._move = refuse
    assert not stage.needs_home


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


def test_gives_up_on_a_silent_port_with_advice(bench):
    bench.unit.mute = True
    with pytest.raises(InitialisationError, match=r"no pan-tilt unit answers within 30 s.*baud"):
        bench.open()
    assert not bench.line.is_open


def test_implausible_description_is_refused(bench, monkeypatch):
    monkeypatch.setitem(LIMITS, "P", (3090, -3090))
    with pytest.raises(InitialisationError, match="axis P implausibly"):
        bench.open()


def test_port_that_is_not_there():
    with pytest.raises(NotAvailableError, match="there is no such serial port"):
        make_stage("ptu", {"port": "/dev/no-such-port"}).open()


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


def test_emulated_unit_is_unplugged_and_replugged(tmp_path):
    with PtuEmulator(tmp_path / "ptu") as emulator:
        stage = make_stage("ptu", {"port": emulator.port})
        stage.open()
        emulator.unplug()
        with pytest.raises(DeviceLostError, match="the serial line is gone"):
            stage.move_to(radians(1), 0.0)
        stage.close()
        with pytest.raises(NotAvailableError):
            stage.open()
        emulator.plug()
        stage.open()
        assert stage.needs_home
        stage.home()
        stage.close()
