"""An SR4000 behind the real libusb: umockdev answers usbfs for a child process. Run by the system's Python.

    umockdev-wrapper python3 umockdev_host.py PERIOD UNPLUG_AT COMMAND…

PERIOD is seconds from trigger to frame. UNPLUG_AT is the frame with which the camera vanishes, to come back
half a second later; 0 = never. The exit status is that of COMMAND.
"""

import errno
import os
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

SUBMIT, REAP, REAP_NOW, DISCARD = 0x8038550A, 0x4008550C, 0x4008550D, 0x550B
GET_CAPABILITIES, CLAIM, RELEASE, GET_DRIVER, CLEAR_HALT = (
    0x8004551A,
    0x8004550F,
    0x80045510,
    0x41045508,
    0x80045515,
)
NO_PACKET_SIZE_LIMIT = 0x04
URB_BYTES = 56
CONTROL = 2

FRAME_BYTES = 101376
ABSENCE = 0.5

DEVICE = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 0xFF, 0, 0, 64, 0x1AD2, 0x0075, 1, 1, 2, 3, 1)
CONFIGURATION = struct.pack("<BBHBBBBB", 9, 2, 32, 1, 1, 0, 0x80, 250)
INTERFACE = struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 2, 0xFF, 0, 0, 0)
ENDPOINTS = b"".join(struct.pack("<BBBBHB", 7, 5, address, 2, 512, 0) for address in (0x02, 0x86))
DESCRIPTORS = (DEVICE + CONFIGURATION + INTERFACE + ENDPOINTS).hex().upper()

SYSFS = "/devices/pci0000:00/0000:00:14.0/usb1/1-4"
HUB = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 9, 0, 1, 64, 0x1D6B, 2, 1, 3, 2, 1, 1)
HUB_DESCRIPTORS = (HUB + struct.pack("<BBHBBBBB", 9, 2, 9, 0, 1, 0, 0xE0, 0)).hex().upper()
ROOT_HUB = f"""P: /devices/pci0000:00/0000:00:14.0/usb1
N: bus/usb/001/001
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
A: busnum=1\\n
A: devnum=1\\n
A: speed=480\\n
A: bConfigurationValue=1\\n
H: descriptors={HUB_DESCRIPTORS}

"""
DESCRIPTION = f"""P: {SYSFS}
N: bus/usb/001/%(address)03d={DESCRIPTORS}
E: DEVNAME=/dev/bus/usb/001/%(address)03d
E: DEVTYPE=usb_device
E: DRIVER=usb
E: SUBSYSTEM=usb
E: BUSNUM=001
E: DEVNUM=%(address)03d
E: MAJOR=189
E: MINOR=%(minor)d
A: busnum=1\\n
A: devnum=%(address)d\\n
A: speed=480\\n
A: bConfigurationValue=1\\n
A: idVendor=1ad2\\n
A: idProduct=0075\\n
A: serial=4000002F\\n
H: descriptors={DESCRIPTORS}

"""


def frame(number):
    """Distance counts rise along the image from 4 · number; the amplitude is 1000 + number."""
    distance = b"".join(struct.pack("<H", 4 * ((pixel + number) % 16384)) for pixel in range(25344))
    return distance + struct.pack("<H", 1000 + number) * 25344


class Camera:
    """Answers the requests of usbfs."""

    def __init__(self, testbed, period, unplug_at):
        self.testbed, self.period, self.unplug_at = testbed, period, unplug_at
        self.frames = [frame(number) for number in range(16)]
        self.triggers = 0
        self.address = 4
        testbed.add_from_string(ROOT_HUB)
        self.clients = set()
        self.gone = set()  # whoever had the camera open when it was unplugged
        self.ready = []  # (time, bytes)
        self.flying = []  # (urb, buffer) waiting for an image
        self.done = []
        self.plug()

    @property
    def node(self):
        return f"/dev/bus/usb/001/{self.address:03d}"

    def plug(self):
        self.address += 1
        self.testbed.add_from_string(DESCRIPTION % {"address": self.address, "minor": self.address - 1})
        self.handler = UMockdev.IoctlBase()
        self.handler.connect("handle-ioctl", self.handle)
        self.testbed.attach_ioctl(self.node, self.handler)
        self.testbed.uevent("/sys" + SYSFS, "add")
        return False

    def unplug(self):
        self.testbed.detach_ioctl(self.node)
        self.testbed.uevent("/sys" + SYSFS, "remove")
        self.testbed.remove_device("/sys" + SYSFS)
        Path(self.testbed.get_root_dir() + self.node).unlink()
        GLib.timeout_add(round(ABSENCE * 1000), self.plug)
        return False

    def handle(self, _handler, client):
        request = client.get_request() & 0xFFFFFFFF
        self.clients.add(client)
        if client in self.gone and request not in (REAP, REAP_NOW):
            client.complete(-1, errno.ENODEV)
        elif request == GET_CAPABILITIES:
            client.get_arg().resolve(0, 4).update(0, struct.pack("<I", NO_PACKET_SIZE_LIMIT))
            client.complete(0, 0)
        elif request == GET_DRIVER:
            client.complete(-1, errno.ENODATA)
        elif request in (CLAIM, RELEASE, CLEAR_HALT):
            client.complete(0, 0)
        elif request == SUBMIT:
            self.submit(client)
        elif request in (REAP, REAP_NOW):
            self.reap(client)
        elif request == DISCARD:
            self.discard(client)
        else:
            client.complete(-1, errno.ENOTTY)
        return True

    def submit(self, client):
        urb = client.get_arg().resolve(0, URB_BYTES)
        fields = bytes(urb.retrieve())  # `data` would end at the first zero
        kind, endpoint = fields[0], fields[1]
        (length,) = struct.unpack_from("<i", fields, 24)
        buffer = urb.resolve(16, length)
        if kind == CONTROL:
            setup = bytes(buffer.retrieve())[:8]
            is_there = setup[:2] != bytes((0x40, 0xB0)) or self.trigger()
            self.finish(urb, 0 if is_there else -errno.ESHUTDOWN, 0)
        elif endpoint & 0x80:
            self.flying.append((urb, buffer))
        else:
            self.finish(urb, 0, length)
        client.complete(0, 0)

    def trigger(self):
        self.triggers += 1
        if self.triggers == self.unplug_at:
            self.gone |= self.clients
            GLib.idle_add(self.unplug)
            return False
        self.ready.append((time.monotonic() + self.period, self.frames[self.triggers % 16]))
        return True

    def reap(self, client):
        if not self.done and self.flying and self.ready:
            # libusb asks in a loop while the node is writable: wait a little instead of spinning
            time.sleep(min(max(self.ready[0][0] - time.monotonic(), 0.0), 0.002))
            if time.monotonic() >= self.ready[0][0]:
                urb, buffer = self.flying.pop(0)
                content = self.ready.pop(0)[1]
                buffer.update(0, content)
                self.finish(urb, 0, len(content))
        if not self.done:
            time.sleep(0.0005)
            client.complete(-1, errno.EAGAIN)
            return
        client.get_arg().resolve(0, 8).set_ptr(0, self.done.pop(0))
        client.complete(0, 0)

    def discard(self, client):
        if self.flying:
            self.finish(self.flying.pop(0)[0], -errno.ENOENT, 0)
        client.complete(0, 0)

    def finish(self, urb, status, actual):
        urb.update(4, struct.pack("<i", status))
        urb.update(28, struct.pack("<i", actual))
        self.done.append(urb)


def main():
    period, unplug_at, command = float(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    testbed = UMockdev.Testbed.new()
    Camera(testbed, period, unplug_at)
    loop = GLib.MainLoop()
    environment = {"LD_PRELOAD": "libumockdev-preload.so.0", "UMOCKDEV_DIR": testbed.get_root_dir()}
    child = subprocess.Popen(command, env={**os.environ, **environment})
    threading.Thread(target=lambda: (child.wait(), GLib.idle_add(loop.quit)), daemon=True).start()
    loop.run()
    return child.returncode


if __name__ == "__main__":
    sys.exit(main())
