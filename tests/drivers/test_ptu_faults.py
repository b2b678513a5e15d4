"""The pan-tilt unit at fault: a bad line, a blocked head, a limit, a restart, a plug that is pulled."""

from math import degrees, radians

import pytest
from emulators.ptu_emulator import COUNT, LIMITS, PtuEmulator
from emulators.virtual_line import Fault
from ptu_bench import Bench

from drivers.backends import make_stage
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    NotAvailableError,
    OperationError,
    StateError,
)


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def stage(bench):
    return bench.open()


def garbled(*pieces):
    return Fault("garbled", pieces=pieces)


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


def test_a_blocked_head_is_halted_when_time_is_up(bench, stage):
    stage.move_to(radians(20), 0.0)
    bench.unit.axes["P"].stop()
    halts = len(bench.unit.halts)
    with pytest.raises(DeviceTimeoutError, match="check that nothing blocks it"):
        stage.wait(2.0)
    assert len(bench.unit.halts) > halts
    assert not stage.needs_home, "its position is still known"


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


def test_a_unit_that_always_reports_0_is_not_believed_to_have_arrived(bench, stage):
    values = bench.unit._values
    bench.unit._values = lambda axis: {**values(axis), "P": (values(axis)["P"][0], 0, "")}
    stage.move_to(radians(0.2), 0.0)
    with pytest.raises(DeviceTimeoutError, match="not at its target"):
        stage.wait(2.0)
