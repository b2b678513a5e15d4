"""Packets of Dynamixel's protocol 2.0."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.stages.dynamixel_packets import Packet, decode, encode

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
