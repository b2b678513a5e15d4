"""Packets of a capture file: pcapng (IETF draft-ietf-opsawg-pcapng) and classic pcap.

Only what USB captures need is read: section, interface, enhanced and simple packet blocks.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from drivers.errors import RecordingError

SECTION, INTERFACE, SIMPLE_PACKET, ENHANCED_PACKET = 0x0A0D0D0A, 1, 3, 6
BYTE_ORDER_MAGIC = 0x1A2B3C4D
OPTION_END, OPTION_TIME_RESOLUTION = 0, 9

PCAP_MAGICS = {
    b"\xd4\xc3\xb2\xa1": ("<", 1000),
    b"\xa1\xb2\xc3\xd4": (">", 1000),
    b"\x4d\x3c\xb2\xa1": ("<", 1),
    b"\xa1\xb2\x3c\x4d": (">", 1),
}
"""First bytes of a classic pcap file: byte order, and nanoseconds per unit of its fractions."""


class Packet(NamedTuple):
    """One captured packet; `order` is the byte order of the machine that captured it (`<` or `>`)."""

    link_type: int
    timestamp: int
    data: bytes
    order: str


class _Interface(NamedTuple):
    link_type: int
    ticks_per_second: int


def read_packets(path: Path) -> Iterator[Packet]:
    """Packets of a capture, in the order of the file; a torn end is left out.

    Raises:
        RecordingError: the file cannot be read, or is neither pcapng nor pcap.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot read the capture ({error})") from error
    if content[:4] == SECTION.to_bytes(4, "little"):
        packets = _pcapng(content, path)
    elif content[:4] in PCAP_MAGICS:
        packets = _pcap(content)
    else:
        raise RecordingError(
            f"{path}: neither a pcapng nor a pcap capture; save it from Wireshark or tcpdump"
        )
    try:
        yield from packets
    except struct.error as error:
        raise RecordingError(f"{path}: damaged: a block is too short ({error})") from error


def _pcap(content: bytes) -> Iterator[Packet]:
    order, fraction = PCAP_MAGICS[content[:4]]
    (link_type,) = struct.unpack_from(order + "I", content, 20)
    position = 24
    while position + 16 <= len(content):
        seconds, parts, captured, _ = struct.unpack_from(order + "4I", content, position)
        position += 16
        if position + captured > len(content):
            return
        # the upper bits of the field may tell about frame check sequences
        yield Packet(
            link_type & 0xFFFF,
            seconds * 1_000_000_000 + parts * fraction,
            content[position : position + captured],
            order,
        )
        position += captured


def _pcapng(content: bytes, path: Path) -> Iterator[Packet]:
    order, interfaces, position = "<", list[_Interface](), 0
    while position + 12 <= len(content):
        if content[position : position + 4] == SECTION.to_bytes(4, "little"):
            little = struct.unpack_from("<I", content, position + 8)[0] == BYTE_ORDER_MAGIC
            order, interfaces = "<" if little else ">", []
        kind, size = struct.unpack_from(order + "II", content, position)
        if size < 12 or size % 4:
            raise RecordingError(f"{path}: damaged at byte {position}: a block of {size} bytes")
        if position + size > len(content):
            return
        body = content[position + 8 : position + size - 4]
        if kind == INTERFACE:
            interfaces.append(_interface(body, order))
        elif kind in (ENHANCED_PACKET, SIMPLE_PACKET):
            yield _packet(kind, body, order, interfaces, path)
        position += size


def _packet(kind: int, body: bytes, order: str, interfaces: list[_Interface], path: Path) -> Packet:
    number, ticks = 0, 0
    if kind == ENHANCED_PACKET:
        number, high, low, captured, _ = struct.unpack_from(order + "5I", body)
        ticks, start = high << 32 | low, 20
    else:
        (captured,) = struct.unpack_from(order + "I", body)
        start = 4
    if number >= len(interfaces):
        raise RecordingError(f"{path}: damaged: a packet of interface {number}, which is not described")
    interface = interfaces[number]
    timestamp = ticks * 1_000_000_000 // interface.ticks_per_second
    return Packet(interface.link_type, timestamp, body[start : start + captured], order)


def _interface(body: bytes, order: str) -> _Interface:
    (link_type,) = struct.unpack_from(order + "H", body)
    ticks, position = 1_000_000, 8
    while position + 4 <= len(body):
        code, size = struct.unpack_from(order + "HH", body, position)
        if code == OPTION_END:
            break
        if code == OPTION_TIME_RESOLUTION and size:
            exponent = body[position + 4]
            ticks = 1 << (exponent & 0x7F) if exponent & 0x80 else 10**exponent
        position += 4 + (size + 3) // 4 * 4
    return _Interface(link_type, ticks)
