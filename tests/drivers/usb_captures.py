"""Writes what a stand-in logged as usbmon and USBPcap captures, the way the systems' own tools do."""
# ruff: noqa: E501, ANN - packed headers are one line each

import errno
import struct
from collections.abc import Iterable
from pathlib import Path

from usb_standin import Transfer

USB_LINUX, USB_LINUX_MMAPPED, USBPCAP = 189, 220, 249
URB_BYTES = 16384
"""usbfs of the time cut longer transfers into pieces of this size."""

KINDS = {"control": 2, "write": 3, "read": 3}
Packet = tuple[int, bytes]


def usbmon_packets(
    transfers: Iterable[Transfer], link_type: int = USB_LINUX_MMAPPED, order: str = "<", snap: int = 1 << 20
) -> list[Packet]:
    packets: list[Packet] = []
    for number, transfer in enumerate(t for whole in transfers for t in _pieces(whole)):
        status = -transfer.status
        reads = bool(transfer.endpoint & 0x80)
        base = (0xFFFF888000000000 + number, KINDS[transfer.kind], transfer.endpoint, 5, 1)
        submit = _usbmon(
            base, "S", transfer.submitted, -errno.EINPROGRESS, transfer, transfer.sent, link_type, order
        )
        done = _usbmon(base, "C", transfer.completed, status, transfer, transfer.received, link_type, order)
        assert reads or not transfer.received
        packets += [(transfer.submitted, submit[:snap]), (transfer.completed, done[:snap])]
    return packets


def _usbmon(base, event, stamp, status, transfer, data, link_type, order) -> bytes:
    identifier, kind, endpoint, device, bus = base
    begins = event == "S"
    reads = bool(endpoint & 0x80)
    no_setup = 0 if begins and transfer.setup else ord("-")
    no_data = 0 if (begins != reads) and data else ord("<" if begins else ">")
    length = transfer.asked if begins else len(data) if reads else transfer.asked
    header = struct.pack(
        order + "QBBBBHBBqiiII", identifier, ord(event), kind, endpoint, device, bus, no_setup, no_data,
        stamp // 10**9, stamp % 10**9 // 1000, status, length, len(data),
    ) + (transfer.setup if begins else b"").ljust(8, b"\0")  # fmt: skip
    return header.ljust(48 if link_type == USB_LINUX else 64, b"\0") + data


def _pieces(transfer: Transfer) -> list[Transfer]:
    """A read comes in pieces of 16 KiB; the pieces are asked for one after the other."""
    if transfer.kind != "read" or transfer.asked <= URB_BYTES or transfer.status:
        return [transfer]
    starts = range(0, transfer.asked, URB_BYTES)
    step = max((transfer.completed - transfer.submitted) // len(starts), 1)
    return [
        Transfer(
            "read",
            transfer.endpoint,
            transfer.submitted + index * step,
            transfer.submitted + (index + 1) * step,
            received=transfer.received[start : start + URB_BYTES],
            asked=min(URB_BYTES, transfer.asked - start),
        )
        for index, start in enumerate(starts)
    ]


def usbpcap_packets(transfers: Iterable[Transfer], old: bool = False) -> list[Packet]:
    """As USBPcap 1.3 and later write it; `old`: with data and status stages of their own."""
    packets: list[Packet] = []
    for number, transfer in enumerate(transfers):
        control = transfer.kind == "control"
        if not control:
            packets.append((transfer.submitted, _usbpcap(number, transfer, False, transfer.sent)))
            packets.append((transfer.completed, _usbpcap(number, transfer, True, transfer.received)))
            continue
        first = transfer.setup if old else transfer.setup + transfer.sent
        packets.append((transfer.submitted, _usbpcap(number, transfer, False, first, 0)))
        if old and (transfer.sent or transfer.received):
            data = transfer.sent or transfer.received
            packets.append((transfer.completed, _usbpcap(number, transfer, bool(transfer.received), data, 1)))
        last = b"" if old else transfer.received
        packets.append((transfer.completed, _usbpcap(number, transfer, True, last, 2 if old else 3)))
    return packets


def _usbpcap(number: int, transfer: Transfer, back: bool, data: bytes, stage: int | None = None) -> bytes:
    status = 0xC0000004 if back and transfer.status else 0  # USBD_STATUS_STALL_PID
    kind = KINDS[transfer.kind]
    length = 27 if stage is None else 28
    header = struct.pack(
        "<HQIHBHHBBI", length, 0xFFFFAA0000000000 + number, status, 8, int(back), 1, 5, transfer.endpoint, kind,
        len(data),
    )  # fmt: skip
    return header + (b"" if stage is None else bytes((stage,))) + data


def descriptor_request(ids: tuple[int, int], stamp: int) -> Transfer:
    """The system reading the camera's ids when it was plugged in."""
    body = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 0xFF, 0, 0, 64, *ids, 1, 1, 2, 3, 1)
    return Transfer("control", 0x80, stamp, stamp + 1000, bytes((0x80, 6, 0, 1, 0, 0, 18, 0)), b"", body, 18)


def descriptor_requests(ids: tuple[int, int], stamp: int, serial: str = "4000002F") -> list[Transfer]:
    """The system reading the camera's ids, and its serial number, when it was plugged in."""
    text = serial.encode("utf-16-le")
    body = bytes((2 + len(text), 3)) + text
    setup = bytes((0x80, 6, 3, 3, 9, 4, 255, 0))
    string = Transfer("control", 0x80, stamp + 2000, stamp + 3000, setup, b"", body, 255)
    return [descriptor_request(ids, stamp), string]


def write_pcapng(
    path: Path, packets: Iterable[Packet], link_type: int, order: str = "<", resolution: int = 9
) -> None:
    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        size = len(body) + 12
        return struct.pack(order + "II", kind, size) + body + struct.pack(order + "I", size)

    blocks = [block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1))]
    options = struct.pack(order + "HHB3xHH", 9, 1, resolution, 0, 0)
    blocks.append(block(1, struct.pack(order + "HHI", link_type, 0, 0) + options))
    for stamp, data in packets:
        ticks = stamp * 10**resolution // 10**9
        fixed = struct.pack(order + "5I", 0, ticks >> 32, ticks & 0xFFFFFFFF, len(data), len(data))
        blocks.append(block(6, fixed + data))
    blocks.append(block(5, struct.pack(order + "III", 0, 0, 0)))  # interface statistics: to be skipped
    path.write_bytes(b"".join(blocks))


def write_pcap(path: Path, packets: Iterable[Packet], link_type: int, order: str = "<") -> None:
    content = [struct.pack(order + "IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 1 << 20, link_type)]
    for stamp, data in packets:
        content.append(
            struct.pack(order + "4I", stamp // 10**9, stamp % 10**9 // 1000, len(data), len(data)) + data
        )
    path.write_bytes(b"".join(content))
