"""A Grbl controller that moves, is stopped, and loses its position."""

import re
from math import radians

import pytest
from emulators.grbl_emulator import GrblEmulator
from emulators.virtual_line import Fault
from grbl_rig import STEP, GrblRig

from drivers.backends import make_stage
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    LimitError,
    MotionStoppedError,
    OperationError,
    StateError,
)
from drivers.stages.grbl_messages import ANSWER, parse_status


@pytest.fixture
def rig(monkeypatch):
    return GrblRig(monkeypatch)


def angles(stage):
    return stage.position.pan, stage.position.tilt


def degrees_of(pan, tilt):
    return pytest.approx((radians(pan), radians(tilt)), abs=STEP / 2)


def test_without_switches_home_takes_where_it_stands_for_zero(rig):
    rig.grbl.turn_by_hand(X=7.0, Y=-3.0)
    stage = rig.stage(pan_limits=(-20, 30))
    assert stage.homing.startswith("takes where it stands for 0°, 0°")
    assert not stage.finds_reference
    stage.home()
    assert rig.grbl.true == {"X": 7.0, "Y": -3.0}
    assert angles(stage) == (0.0, 0.0)
    stage.move_to(radians(30), radians(10))
    stage.wait()
    assert angles(stage) == degrees_of(30, 10)
    assert rig.grbl.true == pytest.approx({"X": 37.0, "Y": 7.0}, abs=0.004)


def test_without_switches_what_is_on_its_way_does_not_stand_at_zero(rig):
    stage = rig.homed()
    stage.move_to(radians(40), 0.0)
    rig.clock.sleep(1.0)
    with pytest.raises(OperationError, match="it was on its way, and is stopped; turn it to 0°"):
        stage.home()
    assert not rig.grbl.moving
    assert stage.needs_home
    rig.grbl.turn_by_hand(X=0.0)
    stage.home()
    assert angles(stage) == (0.0, 0.0)


def test_with_switches_home_finds_them(rig):
    rig.fit(homing=True)
    rig.grbl.turn_by_hand(X=12.0)
    stage = rig.homed(pan_limits=(-30, 30))
    assert stage.homing.startswith("drives the axes to their limit switches")
    assert stage.finds_reference
    assert rig.grbl.true == pytest.approx({"X": 0.0, "Y": 0.0}, abs=0.004)
    assert angles(stage) == degrees_of(0, 0)


def test_signs_and_zeros_of_the_mount(rig):
    rig.fit(homing=True)
    stage = rig.homed(pan_sign=-1, pan_zero=-80.0)
    assert stage.limits.pan == pytest.approx((radians(-80), radians(100)))
    stage.move_to(radians(30), 0.0)
    stage.wait()
    assert angles(stage) == degrees_of(30, 0)
    assert rig.grbl.true["X"] == pytest.approx(-20, abs=0.004)  # machine -110, 0 at the end of the travel


def test_moves_no_faster_than_asked(rig):
    stage = rig.homed(speed=5.0)
    assert stage.speed == pytest.approx(radians(5))
    before = rig.clock.now()
    stage.move_to(radians(20), 0.0)
    assert rig.grbl.commands[-1] == "$J=G53 G90 G21 X20.0000 Y0.0000 F300.00"
    stage.wait()
    assert (rig.clock.now() - before) / 1e9 == pytest.approx(4.0, abs=0.6)
    rig.grbl.settings[110] = "120.000"
    assert rig.stage().speed == pytest.approx(radians(2))


def test_nothing_is_sent_for_an_angle_beyond_the_limits(rig):
    stage = rig.homed(pan_limits=(-20, 20))
    before = len(rig.grbl.commands)
    for pan, tilt in ((20.1, 0), (0, 45.1)):
        with pytest.raises(LimitError, match="nothing was sent"):
            stage.move_to(radians(pan), radians(tilt))
    assert len(rig.grbl.commands) == before
    assert not stage.needs_home


def test_a_movement_that_is_stopped_is_over_for_good(rig):
    stage = rig.homed()
    stage.move_to(radians(40), 0.0)
    rig.clock.sleep(1.0)
    at = rig.grbl.now()
    stage.stop()
    assert rig.sent_since(at)[0] == b"!\x85"
    assert not rig.grbl.moving
    here = rig.grbl.true
    assert angles(stage) == degrees_of(here["X"], here["Y"])
    rig.line.write(b"~")  # somebody releases the hold
    rig.clock.sleep(5.0)
    assert rig.grbl.true == here
    stage.move_to(0.0, 0.0)
    stage.wait()
    assert angles(stage) == degrees_of(0, 0)


def test_an_interrupt_stops_it_within_a_fifth_of_a_second(rig):
    stage = rig.homed()
    stage.move_to(radians(40), 0.0)
    told = rig.grbl.now() + 1.0
    stage.interrupted = lambda: rig.grbl.now() >= told
    with pytest.raises(MotionStoppedError):
        stage.wait()
    halt = next(at for at, data in rig.line.writes if at >= told and data == b"!\x85")
    assert halt < told + 0.2
    assert not rig.grbl.moving
    assert not stage.needs_home


def test_another_program_s_movement_is_stopped_and_forgotten(rig):
    stage = rig.homed()
    rig.grbl.run_program(X=40.0)
    rig.clock.sleep(1.0)
    stage.stop()
    here = rig.grbl.true
    assert rig.grbl.state == "Idle"
    rig.line.write(b"~")
    rig.clock.sleep(5.0)
    assert rig.grbl.true == here
    assert angles(stage) == degrees_of(here["X"], here["Y"])  # it stood still when it was reset


def test_homing_is_stopped_by_a_reset(rig):
    rig.fit(homing=True)
    stage = rig.stage()
    stage.interrupted = lambda: rig.grbl.state == "Home"
    at = rig.grbl.now()
    with pytest.raises(MotionStoppedError):
        stage.home()
    assert rig.grbl.state == "Alarm"
    assert stage.needs_home
    assert rig.sent_since(at)[-1] == b"\x18"


def test_the_origin_is_at_the_switch_where_grbl_is_built_so(rig):
    rig.fit(homing=True)
    rig.grbl.build_info = rig.grbl.build_info.replace(b"OPT:V", b"OPT:VZ")
    rig.grbl.settings[23] = "1"
    stage = rig.stage(pan_zero=100.0)
    assert stage.limits.pan == pytest.approx((radians(-100), radians(80)))
    assert stage.limits.tilt == pytest.approx((radians(-45), radians(45)))


@pytest.mark.parametrize("homing", [False, True])
def test_after_a_hard_limit_nothing_moves_until_it_is_homed(rig, homing):
    rig.fit(homing)
    stage = rig.homed()
    stage.move_to(radians(30), 0.0)
    rig.clock.sleep(0.5)
    rig.grbl.hit_limit()
    at, before = rig.grbl.now(), len(rig.grbl.moves)
    with pytest.raises(LimitError, match="ALARM:1, a hard limit switch was hit; home it"):
        stage.wait()
    with pytest.raises(StateError, match="ALARM:1"):
        stage.move_to(0.0, 0.0)
    stage.close()
    stage.open()
    assert stage.needs_home
    assert not any(b"$X" in data or b"$H" in data or b"$J" in data for data in rig.sent_since(at))
    if not homing:
        rig.grbl.turn_by_hand(X=0.0, Y=0.0)
    stage.home()
    assert len(rig.grbl.moves) == before + 1 + homing
    assert max(abs(pan) for pan, _ in rig.grbl.moves[before:]) < STEP
    assert rig.grbl.true == pytest.approx({"X": 0.0, "Y": 0.0}, abs=0.004)
    assert angles(stage) == degrees_of(0, 0)


def test_a_restart_in_mid_move_leaves_the_position_unknown_however_often(rig):
    """Each time the controller takes where it was for 0: repeated, it must not walk past the limit."""
    stage = rig.homed(pan_limits=(-30, 30))
    for _ in range(4):
        if not stage.needs_home:
            stage.move_to(radians(30), 0.0)
            rig.clock.sleep(1.0)
        rig.grbl.restart()
        with pytest.raises((DeviceLostError, StateError)):
            stage.wait()
        with pytest.raises(StateError, match="unknown"):
            stage.move_to(radians(30), 0.0)
        stage.close()
        stage.open()
        assert stage.needs_home
    assert len(rig.grbl.moves) == 2  # the homing and the first movement
    assert rig.grbl.true["X"] < 30


def test_an_alarm_whose_message_was_lost_is_noticed(rig):
    stage = rig.homed()
    stage.move_to(radians(30), 0.0)
    rig.grbl.mute = True
    rig.grbl.hit_limit()
    rig.grbl.mute = False
    with pytest.raises(DeviceLostError, match="does not answer"):
        stage.wait()
    assert stage.needs_home


def test_a_report_from_before_a_movement_is_not_taken_for_one_after_it(rig):
    stage = rig.homed()
    rig.line.spoil([None, Fault("twice", 2.0)])
    assert angles(stage) == (0.0, 0.0)
    comes_again = rig.clock.now() / 1e9 + 2.0
    stage.move_to(radians(5), 0.0)
    stage.wait()
    rig.clock.sleep(comes_again - 0.005 - rig.clock.now() / 1e9)
    assert angles(stage) == degrees_of(5, 0)


def test_a_feed_hold_from_elsewhere_is_noticed(rig):
    stage = rig.homed()
    rig.line.write(b"!")
    with pytest.raises(OperationError, match="state Hold"):
        _ = stage.position
    stage.stop()
    assert angles(stage) == degrees_of(0, 0)


def test_a_refusal_says_what_it_means(rig, monkeypatch):
    stage = rig.homed()
    monkeypatch.setattr(rig.grbl, "_jog", lambda *_: rig.grbl.say(b"error:15\r\n"))
    with pytest.raises(OperationError, match=r"error:15 \(beyond the machine's travel\)"):
        stage.move_to(radians(30), 0.0)


def test_not_there_in_time_is_stopped(rig, monkeypatch):
    stage = rig.homed()
    monkeypatch.setattr(rig.grbl, "_jog", lambda *_: rig.grbl.say(b"ok\r\n"))
    stage.move_to(radians(30), 0.0)
    with pytest.raises(DeviceTimeoutError, match="and stopped"):
        stage.wait(1.0)
    assert any(data == b"!\x85" for _, data in rig.line.writes)


def test_unplugging(rig):
    stage = rig.homed()
    stage.move_to(radians(30), 0.0)
    rig.line.plugged = False
    with pytest.raises(DeviceLostError, match="serial line is gone"):
        stage.wait()
    assert stage.needs_home


def test_messages():
    status = parse_status("<Hold:1|MPos:1.5,-2,0|FS:0,0|Ov:100,100,100>")
    assert status is not None
    assert (status.state, status.phase, status.machine, status.stands) == ("Hold", 1, (1.5, -2.0, 0.0), False)
    for line, stands in (
        ("<Hold:0|MPos:0,0,0>", True),
        ("<Door:1|MPos:0,0,0>", True),
        ("<Door:2|MPos:0,0,0>", False),
        ("<Jog|MPos:0,0,0>", False),
    ):
        found = parse_status(line)
        assert found is not None
        assert found.stands == stands
    assert parse_status("<Idle|MPos:1.5,-2") is None
    assert parse_status("<Idle|MPos:30.\ufffd00,0,0|FS:0,0>") is None
    assert parse_status("ok") is None
    assert ANSWER.search("ok")
    assert not ANSWER.search(">G54G20:ok")


def test_emulated_controller_end_to_end():
    with GrblEmulator() as emulator:
        options = {"port": emulator.port, "tilt_axis": "Y", "speed": 100.0}
        with make_stage("grbl", options) as stage:
            stage.home()
            stage.move_to(radians(12.3), radians(-4))
            stage.wait()
            assert angles(stage) == degrees_of(12.3, -4)
            emulator.hit_limit()
            with pytest.raises(LimitError):
                keep_asking(stage)
            stage.home()
            assert angles(stage) == (0.0, 0.0)
            emulator.restart()
            with pytest.raises(DeviceLostError):
                keep_asking(stage)
        written = [line for line in emulator.commands if re.match(r"\$\d+=|\$N\d=|G10|G28\.1|\$RST", line)]
        assert not written, "nothing writes the EEPROM"


def test_emulated_controller_with_switches_is_unplugged_and_replugged(tmp_path):
    with GrblEmulator(tmp_path / "grbl", homing=True) as emulator:
        stage = make_stage("grbl", {"port": emulator.port, "speed": 100.0})
        stage.open()
        stage.home()
        assert stage.position.pan == pytest.approx(0.0, abs=STEP / 2)
        emulator.unplug()
        with pytest.raises(DeviceLostError):
            stage.move_to(radians(1), 0.0)
        stage.close()
        emulator.plug()
        stage.open()
        stage.home()
        stage.close()


def keep_asking(stage):
    while True:
        _ = stage.position
