from math import radians, tau

import pytest
from emulators.dynamixel_emulator import DynamixelEmulator
from emulators.scripted_port import UNPLUGGED, ScriptedPort
from hypothesis import given
from hypothesis import strategies as st

from drivers.backends import make_stage
from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    OperationError,
    StateError,
)
from drivers.stages.dynamixel_packets import Packet, decode, encode

COUNT = tau / 4096

PING = "ff ff fd 00 01 03 00 01 19 4e"
TORQUE_ON = "ff ff fd 00 01 06 00 03 40 00 01 db 66"
GOAL_2048 = "ff ff fd 00 01 09 00 03 74 00 00 08 00 00 42 89"
READ_POSITION = "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15"
READ_MOVING = "ff ff fd 00 01 07 00 02 7a 00 01 00 36 93"
EXTENDED_MODE = "ff ff fd 00 01 06 00 03 0b 00 04 59 63"
STATUS_OK = "ff ff fd 00 01 04 00 55 00 a1 0c"
STATUS_2048 = "ff ff fd 00 01 08 00 55 00 00 08 00 00 1c 38"


@pytest.mark.parametrize(
    ("text", "packet"),
    [
        (PING, Packet(1, 1, b"")),
        (TORQUE_ON, Packet(1, 3, b"\x40\x00\x01")),
        (GOAL_2048, Packet(1, 3, b"\x74\x00\x00\x08\x00\x00")),
        (READ_POSITION, Packet(1, 2, b"\x84\x00\x04\x00")),
        (READ_MOVING, Packet(1, 2, b"\x7a\x00\x01\x00")),
        (EXTENDED_MODE, Packet(1, 3, b"\x0b\x00\x04")),
        (STATUS_OK, Packet(1, 0x55, b"\x00")),
        (STATUS_2048, Packet(1, 0x55, b"\x00\x00\x08\x00\x00")),
    ],
)
def test_packets_are_those_of_the_manual(text, packet):
    assert encode(packet) == bytes.fromhex(text)
    assert decode(bytes.fromhex(text)) == (packet, b"")


@given(
    parameters=st.lists(st.sampled_from(b"\xff\xfd\x00\x41"), max_size=12).map(bytes),
    noise=st.binary(max_size=20),
)
def test_any_packet_is_found_behind_noise(parameters, noise):
    packet = Packet(1, 3, parameters)
    rest = noise + encode(packet) + b"\x00" * 40  # what follows completes a false start in the noise
    found = []
    while (step := decode(rest))[0] is not None:
        found.append(step[0])
        rest = step[1]
    assert packet in found


def test_packet_that_is_not_whole_is_kept():
    data = bytes.fromhex(STATUS_2048)
    assert decode(data[:9]) == (None, data[:9])
    assert decode(b"\x00" + data[:2]) == (None, data[:2])


def read(address: int, size: int) -> bytes:
    return encode(Packet(1, 2, address.to_bytes(2, "little") + size.to_bytes(2, "little")))


def status(value: int, size: int, error: int = 0) -> bytes:
    return encode(Packet(1, 0x55, bytes([error]) + value.to_bytes(size, "little", signed=True)))


OK = bytes.fromhex(STATUS_OK)
TORQUE_IS_ON = (read(64, 1), status(1, 1))
STILL = (bytes.fromhex(READ_MOVING), status(0, 1))
AT_2048 = (bytes.fromhex(READ_POSITION), bytes.fromhex(STATUS_2048))
GREETING = [
    (bytes.fromhex(PING), encode(Packet(1, 0x55, b"\x00\x24\x04\x2e"))),
    (read(11, 1), status(3, 1)),
    (read(52, 4), status(0, 4)),
    (read(48, 4), status(4095, 4)),
    (bytes.fromhex(TORQUE_ON), OK),
]
MOVE = [TORQUE_IS_ON, (bytes.fromhex(GOAL_2048), OK)]


class Script:
    def __init__(self, monkeypatch):
        self._monkeypatch = monkeypatch
        self.clock = VirtualClock()

    def stage(self, *exchanges, greeting=GREETING, **options):
        self.port = ScriptedPort(self.clock, [*greeting, *exchanges])
        self._monkeypatch.setattr("serial.serial_for_url", self.port.open)
        stage = make_stage("dynamixel", {"port": "scripted", **options}, self.clock)
        stage.open()
        return stage


@pytest.fixture
def script(monkeypatch):
    return Script(monkeypatch)


def test_moves_waits_and_reports_its_own_position(script):
    moving = (bytes.fromhex(READ_MOVING), status(1, 1))
    stage = script.stage(*MOVE, moving, STILL, AT_2048, (bytes.fromhex(READ_POSITION), status(2046, 4)))
    assert stage.limits.pan == pytest.approx((-2048 * COUNT, 2047 * COUNT))
    assert stage.limits.tilt == (0.0, 0.0)
    assert stage.resolution == COUNT
    stage.move_to(0.0, 0.0)
    stage.wait()
    assert stage.position.pan == pytest.approx(-2 * COUNT)
    script.port.finish()


def test_sign_zero_and_limits_of_the_mount(script):
    goal = encode(Packet(1, 3, b"\x74\x00" + (1000 - 512).to_bytes(4, "little")))
    stage = script.stage(TORQUE_IS_ON, (goal, OK), pan_sign=-1, pan_zero=1000, pan_limits=(-60, 60))
    assert stage.limits.pan == (radians(-60), radians(60))
    stage.move_to(radians(45), 0.0)
    script.port.finish()


@pytest.mark.parametrize(
    ("reply", "repeated"),
    [
        (bytes.fromhex(READ_POSITION) + bytes.fromhex(STATUS_2048), False),
        ([b"\xff\xff\xfd\x00\x01\xf0\xff", bytes.fromhex(STATUS_2048)], False),
        ([bytes.fromhex(STATUS_2048)[:5], 0.1, bytes.fromhex(STATUS_2048)[5:]], False),
        (encode(Packet(2, 0x55, b"\x00\x01\x02\x03\x04")) + bytes.fromhex(STATUS_2048), False),
        (bytes.fromhex(STATUS_2048)[:-1] + b"\x39", True),
        (b"", True),
    ],
    ids=["echo", "noise", "partial", "other-servo", "damaged", "lost"],
)
def test_reads_a_position_over_a_bad_line(script, reply, repeated):
    stage = script.stage((bytes.fromhex(READ_POSITION), reply), *([AT_2048] if repeated else []))
    assert stage.position.pan == 0.0
    script.port.finish()


def test_nothing_is_sent_for_an_angle_beyond_the_limits(script):
    stage = script.stage()
    with pytest.raises(LimitError, match="nothing was sent"):
        stage.move_to(radians(181), 0.0)
    assert not stage.needs_home
    script.port.finish()


def test_extended_mode_has_half_a_turn_either_way(script):
    greeting = [GREETING[0], (read(11, 1), status(4, 1)), *GREETING[2:]]
    stage = script.stage(greeting=greeting)
    assert stage.limits.pan == pytest.approx((radians(-180), radians(180)))


def test_other_modes_are_refused_with_the_remedy(script):
    greeting = [GREETING[0], (read(11, 1), status(1, 1)), *GREETING[2:4]]
    with pytest.raises(InitialisationError, match="operating mode 1; set it to 3"):
        script.stage(greeting=greeting)


def test_limits_beyond_the_servo_are_refused(script):
    with pytest.raises(InitialisationError, match=r"cannot have limits -200° to 90°"):
        script.stage(pan_limits=(-200, 90))


def test_missing_servo_is_refused_with_advice(script):
    with pytest.raises(InitialisationError, match=r"Dynamixel 1 does not answer.*57600"):
        script.stage(greeting=[(bytes.fromhex(PING), b"")] * 2)
    assert not script.port.is_open


def test_hardware_alert_is_reported(script):
    stage = script.stage((bytes.fromhex(READ_POSITION), status(2048, 4, error=0x80)))
    with pytest.raises(OperationError, match="hardware alert"):
        _ = stage.position


def test_servo_that_let_go_has_restarted(script):
    stage = script.stage((read(64, 1), status(0, 1)))
    with pytest.raises(DeviceLostError, match="has restarted"):
        stage.move_to(0.0, 0.0)
    assert stage.needs_home


def test_limit_reported_by_the_servo_makes_the_position_unknown(script):
    stage = script.stage(TORQUE_IS_ON, (bytes.fromhex(GOAL_2048), encode(Packet(1, 0x55, b"\x06"))))
    with pytest.raises(LimitError, match="beyond the servo's limits"):
        stage.move_to(0.0, 0.0)


def test_unplugging_and_silence(script):
    stage = script.stage((bytes.fromhex(READ_POSITION), [0.01, UNPLUGGED]))
    with pytest.raises(DeviceLostError, match="serial line is gone"):
        _ = stage.position
    with pytest.raises(StateError):
        _ = stage.position
    stage = script.stage(*[(bytes.fromhex(READ_POSITION), b"")] * 2)
    with pytest.raises(DeviceLostError, match="does not answer"):
        _ = stage.position


@pytest.mark.parametrize("echo", [False, True])
def test_emulated_servos_end_to_end(echo):
    with DynamixelEmulator(echo=echo) as emulator:
        options = {"port": emulator.port, "tilt_id": 2, "tilt_sign": -1}
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
