"""The vendor's software before a stand-in of a camera."""

from dataclasses import dataclass, field

import usb.core
from usb_standin import Firmware


@dataclass
class VendorSoftware:
    """What the vendor's software might do: set up, take frames, tune, close. Its requests are invented."""

    device: usb.core.Device
    firmware: Firmware = field(default_factory=Firmware)
    frame_bytes: int = 101376
    bulk_in: int = 0x86

    def session(self, frames: int = 10, registers: tuple[tuple[int, int], ...] = ()) -> None:
        self.open()
        for _ in range(frames):
            self.acquire()
        for number, value in registers:
            self.device.write(0x02, bytes((number, value)))
            self.acquire()
        self.device.ctrl_transfer(0x40, 0xCF, 0, 0, None)

    def open(self) -> None:
        self.device.ctrl_transfer(0xC0, 0xC0, 0, 0, 64)
        for number, content in enumerate(self.firmware.uploads):
            self.device.ctrl_transfer(0x40, self.firmware.announce, number, 0, None)
            for start in range(0, len(content), 16384):
                self.device.write(0x02, content[start : start + 16384])
        while (
            self.firmware.uploads
            and self.device.ctrl_transfer(0xC0, self.firmware.status_request, 0, 0, 1).tobytes() != b"R"
        ):
            pass
        self.device.write(0x02, bytes((9, 20)))

    def acquire(self) -> bytes:
        self.device.ctrl_transfer(0x40, self.firmware.trigger, 0, 0, None)
        return self.device.read(self.bulk_in, self.frame_bytes, 1000).tobytes()
