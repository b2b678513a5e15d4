"""USB transfers of a capture: Linux usbmon and Windows USBPcap.

Sources: the kernel's Documentation/usb/usbmon.rst (`struct usbmon_packet`), and USBPcap's description of its
capture format (`USBPCAP_BUFFER_PACKET_HEADER`).
"""

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

from drivers.errors import RecordingError
from drivers.usb.packets import Packet, read_packets
from drivers.usb.steps import DIRECTION_IN

USB_LINUX, USB_LINUX_MMAPPED, USBPCAP = 189, 220, 249
USBMON_HEADER = {USB_LINUX: 48, USB_LINUX_MMAPPED: 64}

USBPCAP_FIELDS = "<HQIHBHHBBI"
USBPCAP_BASE = struct.calcsize(USBPCAP_FIELDS)
STAGE_SETUP, STAGE_DATA = 0, 1

Kind = Literal["isochronous", "interrupt", "control", "bulk"]
KINDS: tuple[Kind, ...] = ("isochronous", "interrupt", "control", "bulk")
"""Both formats number the transfer types so."""

SETUP_BYTES = 8


@dataclass
class Transfer:
    """One transfer, from its request to its end.

    Attributes:
        device: bus and address.
        endpoint: with the direction bit.
        setup: eight bytes, for control transfers.
        data: what was sent or received, as far as the capture holds it.
        length: bytes that really were sent or received.
        asked: bytes allowed for an answer, where the capture tells.
        status: 0 = ended well; None = no end in the capture.
        submitted, completed: ns since the epoch.
    """

    device: tuple[int, int]
    kind: Kind
    endpoint: int
    submitted: int
    setup: bytes = b""
    data: bytes = b""
    length: int = 0
    asked: int = 0
    status: int | None = None
    completed: int | None = None

    @property
    def reads(self) -> bool:
        return bool((self.setup[0] if self.setup else self.endpoint) & DIRECTION_IN)

    @property
    def is_truncated(self) -> bool:
        return len(self.data) < self.length

    @property
    def succeeded(self) -> bool:
        return self.status == 0


class _Event(NamedTuple):
    identifier: int
    begins: bool
    ends: bool
    status: int
    transfer: Transfer


def read_transfers(path: Path) -> list[Transfer]:
    """Transfers of a capture in the order in which they were requested.

    Raises:
        RecordingError: not a capture, or one of something else than USB.
    """
    transfers: list[Transfer] = []
    pending: dict[tuple[tuple[int, int], int], Transfer] = {}
    packets = 0
    for packet in read_packets(path):
        packets += 1
        event = _event(packet, path)
        if event is None:
            continue
        key = (event.transfer.device, event.identifier)
        if event.begins:
            pending[key] = event.transfer
            transfers.append(event.transfer)
        elif key in pending:  # else it was requested before the capture began
            _extend(pending[key], event, packet.timestamp)
        if event.ends:
            pending.pop(key, None)
    if not packets:
        raise RecordingError(f"{path}: the capture holds no packets")
    return transfers


def _extend(transfer: Transfer, event: _Event, timestamp: int) -> None:
    transfer.data += event.transfer.data
    transfer.length += event.transfer.length
    if event.ends:
        transfer.status, transfer.completed = event.status, timestamp


def _event(packet: Packet, path: Path) -> _Event | None:
    if packet.link_type in USBMON_HEADER:
        return _usbmon(packet)
    if packet.link_type == USBPCAP:
        return _usbpcap(packet)
    raise RecordingError(
        f"{path}: packets of link type {packet.link_type}, not of USB; capture with usbmon (Linux, link type "
        f"{USB_LINUX} or {USB_LINUX_MMAPPED}) or USBPcap (Windows, {USBPCAP})"
    )


def _usbmon(packet: Packet) -> _Event | None:
    size = USBMON_HEADER[packet.link_type]
    if len(packet.data) < size:
        return None
    fields = struct.unpack_from(packet.order + "QBBBBHBBqiiII", packet.data)
    identifier, event, kind, endpoint, address, bus, no_setup = fields[:7]
    status, length = fields[10], fields[11]
    if kind >= len(KINDS):
        return None
    begins = event == ord("S")
    transfer = Transfer((bus, address), KINDS[kind], endpoint, packet.timestamp)
    if begins and KINDS[kind] == "control" and not no_setup:
        transfer.setup = packet.data[40:48]
    # a request's length is the room for the answer or the bytes to send; an end's, what came
    if begins and endpoint & DIRECTION_IN:
        transfer.asked = length
    elif begins or endpoint & DIRECTION_IN:
        transfer.data, transfer.length = packet.data[size:], length
    return _Event(identifier, begins, not begins, status, transfer)


def _usbpcap(packet: Packet) -> _Event | None:
    if len(packet.data) < USBPCAP_BASE:
        return None
    header, identifier, status, _, info, bus, address, endpoint, kind, length = struct.unpack_from(
        USBPCAP_FIELDS, packet.data
    )
    if kind >= len(KINDS):
        return None
    from_device = bool(info & 1)
    transfer = Transfer((bus, address), KINDS[kind], endpoint, packet.timestamp)
    transfer.data, transfer.length = packet.data[header:], length
    if KINDS[kind] != "control":
        return _Event(identifier, not from_device, from_device, status, transfer)
    stage = packet.data[USBPCAP_BASE] if min(header, len(packet.data)) > USBPCAP_BASE else STAGE_SETUP
    begins = stage == STAGE_SETUP and not from_device
    if begins:
        transfer = replace(
            transfer,
            setup=transfer.data[:SETUP_BYTES],
            data=transfer.data[SETUP_BYTES:],
            length=max(length - SETUP_BYTES, 0),
        )
        transfer.asked = int.from_bytes(transfer.setup[6:8], "little")
    ends = from_device and stage != STAGE_DATA
    return _Event(identifier, begins, ends, status, transfer)
