"""Packets of Dynamixel protocol 2.0 (emanual.robotis.com/docs/en/dxl/protocol2)."""

from __future__ import annotations

from dataclasses import dataclass

HEADER = b"\xff\xff\xfd"
STATUS = 0x55
ALERT = 0x80
"""Bit of a status packet's error: the servo has raised a hardware alert."""


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet: who, what, and its parameters without stuffing."""

    device: int
    instruction: int
    parameters: bytes


def _remainder(byte: int) -> int:
    crc = byte << 8
    for _ in range(8):
        crc = crc << 1 ^ (0x8005 if crc & 0x8000 else 0)
    return crc & 0xFFFF


_REMAINDERS = [_remainder(byte) for byte in range(256)]


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x8005, most significant bit first, start 0, no inversion."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ _REMAINDERS[crc >> 8 ^ byte]
    return crc


def encode(packet: Packet) -> bytes:
    """The bytes of a packet; a header inside the parameters is broken up by one more FD."""
    body = bytes([packet.instruction]) + packet.parameters
    body = body.replace(HEADER, HEADER + b"\xfd")
    head = HEADER + bytes([0, packet.device]) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


def decode(data: bytes) -> tuple[Packet | None, bytes]:
    """The first whole and sound packet in a byte stream, and what follows it.

    Noise and damaged packets before it are dropped. Without a whole packet, the bytes that may be its
    beginning are handed back.
    """
    while (start := data.find(HEADER)) >= 0:
        data = data[start:]
        if len(data) < 7:
            return None, data
        end = 7 + int.from_bytes(data[5:7], "little")
        if end > len(data):
            # A length that noise has blown up would wait for ever: no packet here is longer than 40 bytes.
            if end <= 40:
                return None, data
        elif crc16(data[: end - 2]) == int.from_bytes(data[end - 2 : end], "little") and end >= 10:
            body = data[7 : end - 2].replace(HEADER + b"\xfd", HEADER)
            return Packet(data[4], body[0], body[1:]), data[end:]
        data = data[1:]
    return None, data[-2:]
