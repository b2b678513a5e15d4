"""A SwissRanger behind a pyusb backend: the real driver runs, the device is simulated, faults are scripted."""
# ruff: noqa: ARG002, E501 - the signatures are pyusb's; descriptors are one line each

import errno
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import usb.backend
import usb.core

from drivers.clock import Clock, SystemClock

SR4000_IDS = (0x1AD2, 0x0075)
SR3000_IDS = (0x1AD2, 0x0074)
SR2_IDS = (0x0852, 0x0071)

TRIGGER = 0xB0


@dataclass
class Transfer:
    """One transfer as the bus saw it."""

    kind: str  # control, write, read
    endpoint: int
    submitted: int
    completed: int
    setup: bytes = b""
    sent: bytes = b""
    received: bytes = b""
    asked: int = 0
    status: int = 0


@dataclass
class Firmware:
    """What a simulated camera expects of its host beyond the trigger."""

    uploads: tuple[bytes, ...] = ()  # bulk OUT, each after its announcing request
    announce: int = 0xC1
    status_request: int = 0xC2  # IN; answers 'P' while programming, then 'R'
    trigger: int = TRIGGER
    busy_polls: int = 2


def scene(rows: int, columns: int, number: int, planes: int = 2) -> bytes:
    """A slanted wall with a box in front, noisy; the 14 upper bits of the distance are significant."""
    rng = np.random.default_rng(number)
    distance = np.linspace(18000, 30000, columns)[None, :] + np.zeros((rows, 1))
    distance[rows // 3 : 2 * rows // 3, columns // 3 : columns // 2] = 12000
    distance = (distance + rng.normal(0, 40, distance.shape)).astype(np.uint16) & 0xFFFC
    amplitude = (9000 * (15000 / distance) ** 2 + rng.normal(0, 30, distance.shape)).astype(np.uint16)
    images = [distance, amplitude] if planes == 2 else [distance, amplitude * 2, amplitude]
    return np.stack(images).astype("<u2").tobytes()


class StandIn(usb.backend.IBackend):
    """One camera on one bus.

    Args:
        faults: what happens to the frame of the n-th trigger (from 1): `short`, `late` (the second half
            comes in the next read), `delayed` (arrives only after the driver gave up), `delayed SECONDS`,
            `silent`, `stall`, `eio` (the frame is lost with the transfer), `stall queued`, `eio queued` (it
            comes behind it), `refused` (the trigger itself), `refused exposed` (its answer is lost, the frame
            is not), `doubled` (sent twice), `exposed twice`, `garbage`, `half-garbage`, `constant`, `rolled`,
            `swapped`, `unplug`.
        streams: exposes frame after frame by itself, and holds two while nobody reads.
        ahead: seconds before the trigger at which the exposure begins, in a camera that runs by itself.

    Attributes:
        exposures: ns at which the exposure of each frame began and ended, by the number of its content.
    """

    def __init__(
        self,
        ids: tuple[int, int] = SR4000_IDS,
        *,
        shape: tuple[int, int] = (144, 176),
        planes: int = 2,
        bulk_in: int = 0x86,
        clock: Clock | None = None,
        period: float = 0.02,
        faults: Mapping[int, str] | None = None,
        firmware: Firmware | None = None,
        serial: str | None = "4000002F",
        frames: Callable[[int], bytes] | None = None,
        record: bool = True,
        ahead: float = 0.0,
        number_by_exposure: bool = False,
        streams: bool = False,
    ) -> None:
        self.ids, self.shape, self.planes, self.bulk_in = ids, shape, planes, bulk_in
        self.clock = clock or SystemClock()
        self.period = period
        self.faults = dict(faults or {})
        self.firmware = firmware or Firmware()
        self.serial = serial
        self.frames = frames or (lambda number: scene(*shape, number, planes))
        self.record = record
        self.ahead = ahead
        self.number_by_exposure = number_by_exposure
        self.streams = streams
        self.exposures: dict[int, tuple[int, int]] = {}
        self.log: list[Transfer] = []
        self.plugged = True
        self.address = 5
        self.kernel_driver = False
        self.open_errno: int | None = None
        self.claim_errno: int | None = None
        self.configuration = 1
        self.events: list[str] = []
        self.triggers = 0
        self.power_on()

    def power_on(self) -> None:
        self.registers: dict[int, int] = {}
        self.uploaded: list[bytes] = []
        self.polls = 0
        self.halted = False
        self.queue: list[tuple[int, bytes]] = []  # (ready at, bytes)
        self.open_handles = 0
        self.claimed = False

    def unplug(self) -> None:
        self.plugged = False
        self.address += 1

    def replug(self) -> None:
        self.plugged = True
        self.power_on()

    # descriptors

    def enumerate_devices(self):
        return iter(["camera"] if self.plugged else [])

    def get_device_descriptor(self, dev):
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0xFF, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=64, idVendor=self.ids[0], idProduct=self.ids[1], bcdDevice=0, iManufacturer=1,
            iProduct=2, iSerialNumber=3 if self.serial else 0, bNumConfigurations=1, address=self.address, bus=99,
            port_number=4, port_numbers=(4,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev, config):
        if config:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1,
            iConfiguration=0, bmAttributes=0x80, bMaxPower=250, extra_descriptors=b"",
        )  # fmt: skip

    def get_interface_descriptor(self, dev, intf, alt, config):
        if intf or alt:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=0xFF, bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=b"",
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev, ep, intf, alt, config):
        address = (0x02, self.bulk_in)[ep]
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=address, bmAttributes=2, wMaxPacketSize=512,
            bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=b"",
        )  # fmt: skip

    # handles

    def open_device(self, dev):
        self._require_plugged()
        if self.open_errno:
            raise usb.core.USBError("Access denied (insufficient permissions)", -3, self.open_errno)
        self.open_handles += 1
        return "handle"

    def close_device(self, handle):
        self.open_handles -= 1

    def get_configuration(self, handle):
        return self.configuration

    def set_configuration(self, handle, value):
        self.events.append(f"configuration {value}")
        self.configuration = value

    def claim_interface(self, handle, intf):
        if self.claim_errno or self.kernel_driver:
            raise usb.core.USBError("Resource busy", -6, self.claim_errno or errno.EBUSY)
        self.claimed = True
        self.events.append("claim")

    def release_interface(self, handle, intf):
        self._require_plugged()
        self.claimed = False
        self.events.append("release")

    def is_kernel_driver_active(self, handle, intf):
        return self.kernel_driver

    def detach_kernel_driver(self, handle, intf):
        self.kernel_driver = False
        self.events.append("detach")

    def attach_kernel_driver(self, handle, intf):
        self.kernel_driver = True
        self.events.append("attach")

    def clear_halt(self, handle, endpoint):
        self.halted = False
        self.events.append("clear halt")

    # transfers

    def ctrl_transfer(self, handle, request_type, request, value, index, data, timeout):
        self._require_plugged()
        start = self.clock.now()
        reads = bool(request_type & 0x80)
        asked = len(data)
        answer, status = b"", 0
        if request_type & 0x60 == 0:
            answer = self._string(value & 0xFF)[:asked]
        elif reads:
            answer = self._answer(request)[:asked]
        elif request == self.firmware.trigger:
            status = self._trigger()
        setup = bytes((request_type, request)) + value.to_bytes(2, "little") + index.to_bytes(2, "little")
        setup += asked.to_bytes(2, "little")
        sent = b"" if reads else data.tobytes()
        self._log(Transfer("control", 0x80 if reads else 0, start, 0, setup, sent, answer, asked, status))
        self._check(status)
        if reads:
            data[: len(answer)] = array("B", answer)
            return len(answer)
        return asked

    def bulk_write(self, handle, endpoint, intf, data, timeout):
        self._require_plugged()
        start = self.clock.now()
        content = data.tobytes()
        if len(content) == 2:
            self.registers[content[0]] = content[1]
        else:
            self.uploaded.append(content)
        self._log(Transfer("write", endpoint, start, 0, sent=content, asked=len(content)))
        return len(content)

    def bulk_read(self, handle, endpoint, intf, buffer, timeout):
        self._require_plugged()
        start = self.clock.now()
        content, status = self._deliver(len(buffer), timeout / 1e3)
        self._log(Transfer("read", endpoint, start, 0, received=content, asked=len(buffer), status=status))
        self._check(status)
        memoryview(buffer)[: len(content)] = content
        return len(content)

    # the camera

    @property
    def is_ready(self) -> bool:
        joined = b"".join(self.uploaded)
        return joined == b"".join(self.firmware.uploads)

    def _trigger(self) -> int:
        self.triggers += 1
        fault = self.faults.get(self.triggers, "")
        if fault == "refused":
            return errno.EPIPE
        if fault == "unplug":
            self.unplug()
            return errno.ENODEV
        if not self.is_ready or fault == "silent":
            return 0
        began = self.clock.now() - round(self.ahead * 1e9)
        ready = began + round(self.period * 1e9)
        number = len(self.exposures) + 1 if self.number_by_exposure else self.triggers
        content = self.frames(number)
        self.exposures[number] = (began, ready)
        if fault.startswith("delayed"):
            ready += round(float(fault[len("delayed") :] or 2.005) * 1e9)
        self.queue += [(ready, part) for part in _damaged(content, fault, self.planes)]
        if fault == "exposed twice":
            again = ready + round(self.period * 1e9)
            self.exposures[number + 1] = (ready, again)
            self.queue.append((again, self.frames(number + 1)))
        return errno.EPIPE if fault == "refused exposed" else 0

    def _fill(self) -> None:
        """Expose by itself, one frame after the other, until two wait."""
        while self.streams and len(self.queue) < 2:
            number = len(self.exposures) + 1
            began = max(self.clock.now(), self.exposures[number - 1][1] if number > 1 else 0)
            self.exposures[number] = (began, began + round(self.period * 1e9))
            self.queue.append((self.exposures[number][1], self.frames(number)))

    def _deliver(self, length: int, timeout: float) -> tuple[bytes, int]:
        self._fill()
        if self.halted:
            return b"", errno.EPIPE
        wait = (self.queue[0][0] - self.clock.now()) / 1e9 if self.queue else timeout
        if not self.queue or wait > timeout:
            self.clock.sleep(timeout)
            return b"", errno.ETIMEDOUT
        self.clock.sleep(wait)
        content = self.queue.pop(0)[1]
        self._fill()
        if content == b"stall":
            self.halted = True
            return b"", errno.EPIPE
        if content == b"eio":
            return b"", errno.EIO
        return content[:length], 0

    def _answer(self, request: int) -> bytes:
        if request == self.firmware.status_request:
            self.polls += 1
            return b"R" if self.polls > self.firmware.busy_polls else b"P"
        return bytes(64)

    def _string(self, index: int) -> bytes:
        text = {0: None, 1: "MESA", 2: "SwissRanger", 3: self.serial}.get(index)
        body = b"\x09\x04" if text is None else text.encode("utf-16-le")
        return bytes((2 + len(body), 3)) + body

    def _require_plugged(self) -> None:
        if not self.plugged:
            raise usb.core.USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)

    def _check(self, status: int) -> None:
        if status == errno.ETIMEDOUT:
            raise usb.core.USBTimeoutError("Operation timed out", -7, status)
        if status:
            raise usb.core.USBError(f"transfer failed ({status})", None, status)

    def _log(self, transfer: Transfer) -> None:
        if self.record:
            transfer.completed = self.clock.now()
            self.log.append(transfer)


def _damaged(content: bytes, fault: str, planes: int) -> list[bytes]:
    """The transfers that a frame with a fault becomes."""
    half = len(content) // 2
    noise = np.random.default_rng(1).bytes
    plane = len(content) // planes
    lost = 512 * 25
    parts: dict[str, Callable[[], list[bytes]]] = {
        "short": lambda: [content[:half]],
        "late": lambda: [content[:half], content[half:]],
        "stall": lambda: [b"stall"],
        "eio": lambda: [b"eio"],
        "stall queued": lambda: [b"stall", content],
        "eio queued": lambda: [b"eio", content],
        "doubled": lambda: [content, content],
        "garbage": lambda: [noise(len(content))],
        "half-garbage": lambda: [content[:half] + _half_noise(content[half:])],
        "constant": lambda: [bytes(len(content))],
        "rolled": lambda: [content[lost:] + content[:lost]],
        "swapped": lambda: [content[plane:] + content[:plane]],
    }
    return parts[fault]() if fault in parts else [content]


def _half_noise(content: bytes) -> bytes:
    half = len(content) // 2
    return np.random.default_rng(2).bytes(half) + content[half:]
