"""The Dynamixel stage against emulated servos: consent, limits, turns, halts and faults of the line."""

from itertools import pairwise
from math import radians, tau

import pytest
from emulators.dynamixel_emulator import DynamixelEmulator
from emulators.virtual_line import Fault
from emulators.watched_line import WatchedLine

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    MotionStoppedError,
    OperationError,
    StateError,
)
from drivers.stages.dynamixel_packets import decode

COUNT = tau / 4096


VELOCITY, ACCELERATION = 7, 1  # 9.6 °/s and 21.5 °/s²


class Rig:
    """Two servos in virtual time, and a stage on them."""

    def __init__(self, monkeypatch):
        self.clock = VirtualClock()
        self.bus = DynamixelEmulator()
        self.line = WatchedLine(self.bus, self.clock)
        self.pan, self.tilt = self.bus.servos[1], self.bus.servos[2]
        monkeypatch.setattr("serial.serial_for_url", self.line.open)

    def extended(self):
        for servo in (self.pan, self.tilt):
            servo.mode = 4
        return self

    def stage(self, **options):
        stage = make_stage("dynamixel", {"port": "virtual", "tilt_id": 2, **options}, self.clock)
        stage.open()
        return stage


@pytest.fixture
def rig(monkeypatch):
    return Rig(monkeypatch)


def written(rig):
    """(servo, register) of what was written, in order."""
    return [(servo, address) for servo, address, _ in rig.bus.written]


def test_opening_writes_nothing_and_leaves_limp_servos_limp(rig):
    rig.pan.turn_by_hand(1500)
    stage = rig.stage()
    assert not rig.bus.written
    assert not stage.needs_home
    assert stage.position.pan == pytest.approx(-548 * COUNT)
    assert stage.resolution == COUNT
    assert stage.limits.pan == pytest.approx((-2048 * COUNT, 2047 * COUNT))


def test_the_goal_is_where_it_stands_before_the_torque_is_switched_on(rig):
    rig.pan.turn_by_hand(1500)
    stage = rig.stage()
    stage.move_to(radians(10), 0.0)
    assert written(rig)[:2] == [(1, 108), (1, 64)]
    assert rig.bus.goals[0] == (1, 1500)
    stage.wait()
    assert stage.position.pan == pytest.approx(radians(10), abs=COUNT / 2)


def test_speed_and_acceleration_go_with_each_goal(rig):
    stage = rig.stage(speed=10.0, acceleration=30.0)
    assert stage.speed == pytest.approx(radians(7 * 0.229 * 6))
    before = rig.clock.now()
    stage.move_to(radians(19.2), 0.0)
    stage.wait()
    assert (rig.clock.now() - before) / 1e9 == pytest.approx(2.0, abs=0.3)
    for _, address, data in rig.bus.written:
        assert address == 64 or data[:8] == bytes([ACCELERATION, 0, 0, 0, VELOCITY, 0, 0, 0])
    assert rig.pan.fastest == VELOCITY
    rig.pan.velocity_limit = 3
    assert rig.stage().speed == pytest.approx(radians(3 * 0.229 * 6))


@pytest.mark.parametrize("options", [{"speed": 1.0}, {"acceleration": 20.0}])
def test_what_a_servo_cannot_do_that_slowly_is_refused(rig, options):
    with pytest.raises(InitialisationError, match="greater than or equal to"):
        rig.stage(**options)


def test_sign_zero_and_limits_of_the_mount(rig):
    rig.pan.low, rig.pan.high = 200, 1400
    stage = rig.stage(pan_sign=-1, pan_zero=1000, pan_limits=(-60, 60))
    assert stage.limits.pan == pytest.approx((-400 * COUNT, radians(60)))
    rig.pan.turn_by_hand(1000)
    stage.move_to(radians(45), 0.0)
    stage.wait()
    assert rig.pan.true == 1000 - 512


def test_nothing_is_sent_for_an_angle_beyond_the_limits(rig):
    stage = rig.stage(pan_limits=(-30, 30))
    with pytest.raises(LimitError, match="nothing was sent"):
        stage.move_to(radians(31), 0.0)
    assert not rig.bus.written


def test_an_axis_that_was_turned_beyond_its_limits_is_not_moved_unasked(rig):
    rig.pan.turn_by_hand(2048 + 600)
    stage = rig.stage(pan_limits=(-30, 30))
    with pytest.raises(LimitError, match="reports that pan"):
        stage.move_to(0.0, 0.0)
    assert not rig.bus.written
    stage.home()
    assert stage.position.pan == 0.0


@pytest.mark.parametrize(("zero", "stands"), [(2048, 2000), (100, 4000), (4000, 150), (0, -300)])
def test_an_axis_that_has_lost_count_of_its_turns_does_not_unwind_a_turn(rig, zero, stands):
    """Its place after a loss of power is within the turn; the way to zero is the short one."""
    rig.extended()
    rig.pan.turn_by_hand(stands)
    rig.bus.power_cycle()
    stage = rig.stage(pan_zero=zero)
    angle = (stands - zero + 2048) % 4096 - 2048
    assert stage.position.pan == pytest.approx(angle * COUNT)
    stage.move_to(0.0, 0.0)
    stage.wait()
    assert rig.pan.true - stands == pytest.approx(-angle, abs=1)


def test_a_restart_in_use_does_not_turn_the_camera_round(rig):
    rig.extended()
    rig.pan.turn_by_hand(10)
    rig.bus.power_cycle()
    stage = rig.stage(pan_zero=0)
    stage.move_to(radians(-5), 0.0)
    stage.wait()
    rig.bus.power_cycle()  # -57 counts is 4039 now
    with pytest.raises((DeviceLostError, LimitError)):
        stage.move_to(0.0, 0.0)
    stage.close()
    stage.open()
    assert stage.position.pan == pytest.approx(-57 * COUNT)
    stage.move_to(0.0, 0.0)
    stage.wait()
    assert rig.pan.true == 0


def test_an_axis_wound_up_by_hand_is_refused(rig):
    rig.extended().pan.turn_by_hand(2048 + 5000)
    with pytest.raises(
        InitialisationError, match="439° from its zero: it has been turned past the end of its turn"
    ):
        rig.stage()
    rig.pan.mode = 3
    with pytest.raises(InitialisationError, match="turn it back by hand"):
        rig.stage()


def test_extended_mode_has_half_a_turn_either_way(rig):
    stage = rig.extended().stage()
    assert stage.limits.pan == pytest.approx((radians(-179), radians(179)), abs=radians(0.1))


def test_a_homing_offset_moves_the_turn(rig):
    rig.extended().pan.homing_offset = -2048
    for off in (-100, 100):
        rig.pan.turn_by_hand(2048 + off)
        rig.bus.power_cycle()
        assert rig.stage(pan_zero=0).position.pan == pytest.approx(off * COUNT)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mode": 1}, "operating mode 1; set it to 3"),
        ({"drive_mode": 4}, "clear bit 2 of its drive mode"),
        ({"status_return_level": 1}, r"status return level \(68\) to 2"),
        ({"velocity_limit": 0}, r"velocity limit \(44\)"),
    ],
)
def test_servos_that_are_set_up_otherwise_are_refused_with_the_remedy(rig, change, said):
    for name, value in change.items():
        setattr(rig.pan, name, value)
    with pytest.raises(InitialisationError, match=said):
        rig.stage()
    assert not rig.bus.written


def test_one_servo_cannot_be_both(rig):
    with pytest.raises(InitialisationError, match="pan_id and tilt_id are both 2"):
        rig.stage(pan_id=2)


def test_missing_servo_is_refused_with_advice(rig):
    with pytest.raises(InitialisationError, match=r"Dynamixel 9 does not answer.*57600"):
        rig.stage(tilt_id=9)


def test_a_movement_of_an_earlier_run_is_ended_by_opening(rig):
    rig.stage().move_to(radians(90), 0.0)
    rig.clock.sleep(1.0)
    here = rig.pan.true
    stage = rig.stage()
    assert rig.pan.true == pytest.approx(here, abs=30)
    rig.clock.sleep(5.0)
    assert rig.pan.true == pytest.approx(here, abs=30)
    assert not stage.needs_home


def test_a_movement_that_is_stopped_is_over_for_good(rig):
    stage = rig.stage()
    stage.move_to(radians(40), radians(20))
    rig.clock.sleep(1.0)
    at = rig.bus.now()
    here = rig.pan.true, rig.tilt.true
    stage.stop()
    assert rig.bus.now() - at < 0.2
    rig.clock.sleep(5.0)
    assert (rig.pan.true, rig.tilt.true) == pytest.approx(here, abs=10)
    assert stage.position.pan == pytest.approx((rig.pan.true - 2048) * COUNT)
    before = len(rig.bus.written)
    stage.stop()
    assert len(rig.bus.written) == before, "nothing is written to what stands"


def test_an_interrupt_stops_it_within_a_fifth_of_a_second(rig):
    stage = rig.stage()
    stage.move_to(radians(40), 0.0)
    told = rig.bus.now() + 1.0
    stage.interrupted = lambda: rig.bus.now() >= told
    with pytest.raises(MotionStoppedError):
        stage.wait()
    assert rig.bus.now() < told + 0.2
    assert not rig.pan.moving
    assert not stage.needs_home


@pytest.mark.parametrize(
    "fault", [Fault("lost"), Fault("late", 0.09), Fault("late", 0.3), Fault("late", 2.0)]
)
def test_a_halt_goes_out_although_the_line_is_in_doubt(rig, fault):
    stage = rig.stage()
    stage.move_to(radians(40), 0.0)
    rig.clock.sleep(0.5)
    told = rig.bus.now() + 0.3
    stage.interrupted = lambda: rig.bus.now() >= told
    rig.line.spoil([None] * 30 + [fault] * 3)
    with pytest.raises(MotionStoppedError):
        stage.wait()
    halts = [at for at, data in rig.line.writes if at >= told and data[7:9] == b"\x03\x6c"]
    assert halts[0] - told < 0.2
    assert not rig.pan.moving
    assert len(rig.bus.moves) == 1, "the halt itself goes nowhere"


def test_a_late_acknowledgement_is_not_a_position(rig):
    stage = rig.stage()
    stage.move_to(radians(20), radians(5))
    rig.line.spoil([Fault("late", 0.15), Fault("twice", 0.015), Fault("late", 0.3), Fault("twice", 0.3)] * 2)
    stage.wait()
    position = stage.position
    assert (position.pan, position.tilt) == pytest.approx((radians(20), radians(5)), abs=COUNT / 2)


def test_positions_that_follow_each_other_differ_in_length(rig):
    stage = rig.stage()
    at = len(rig.line.writes)
    for _ in range(30):
        _ = stage.position
    sizes = [decode(data)[0].parameters[2] for _, data in rig.line.writes[at:]]
    assert all(one != other for one, other in pairwise(sizes))
    assert all(len(set(sizes[at : at + 13])) == 13 for at in range(20))


def test_hardware_alert_is_reported_with_its_cause(rig):
    stage = rig.stage()
    stage.move_to(radians(20), 0.0)
    rig.clock.sleep(0.5)
    rig.pan.shut_down(0x24)
    with pytest.raises(OperationError, match=r"hardware alert \(overheating, overload\)"):
        stage.wait()
    with pytest.raises(OperationError, match="power it anew"):
        stage.move_to(0.0, 0.0)
    assert stage.position.pan == pytest.approx((rig.pan.true - 2048) * COUNT, abs=COUNT)


def test_an_axis_that_lets_go_in_mid_move_is_noticed(rig):
    stage = rig.stage()
    stage.move_to(radians(20), 0.0)
    rig.clock.sleep(0.5)
    rig.bus.power_cycle()
    with pytest.raises(DeviceLostError, match="has restarted or lets go"):
        stage.wait()
    assert stage.needs_home


def test_a_restart_that_switches_the_torque_on_again_is_noticed(rig):
    rig.pan.torque_at_start = True
    stage = rig.stage()
    stage.move_to(radians(20), 0.0)
    stage.wait()
    rig.bus.power_cycle()
    with pytest.raises(DeviceLostError, match="has restarted"):
        stage.move_to(0.0, 0.0)


def test_unplugging_and_silence(rig):
    stage = rig.stage()
    rig.bus.mute = True
    with pytest.raises(DeviceLostError, match="does not answer"):
        _ = stage.position
    with pytest.raises(StateError):
        _ = stage.position
    rig.bus.mute = False
    stage.close()
    stage.open()
    rig.line.plugged = False
    with pytest.raises(DeviceLostError, match="serial line is gone"):
        _ = stage.position


@pytest.mark.parametrize("echo", [False, True])
def test_emulated_servos_end_to_end(echo):
    with DynamixelEmulator(echo=echo) as emulator:
        options = {"port": emulator.port, "tilt_id": 2, "tilt_sign": -1, "speed": 80.0}
        with make_stage("dynamixel", options) as stage:
            emulator.servos[1].offset = 3
            stage.move_to(radians(20), radians(10))
            stage.wait()
            assert stage.position.pan == pytest.approx(radians(20) + 3 * COUNT, abs=COUNT / 2)
            assert stage.position.tilt == pytest.approx(radians(10), abs=COUNT / 2)
            emulator.servos[1].offset = 30
            stage.move_to(0.0, 0.0)
            with pytest.raises(DeviceTimeoutError, match="check that nothing blocks it"):
                stage.wait(0.3)
            assert not stage.needs_home
            emulator.servos[1].offset = 0
            emulator.power_cycle()
            with pytest.raises(DeviceLostError):
                stage.move_to(0.0, 0.0)
            stage.home()
            assert stage.position.pan == 0.0
