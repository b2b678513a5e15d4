"""The plain USB camera on a bus of its own."""

from drivers.clock import VirtualClock
from drivers.usb import UsbCamera


def camera(clock: VirtualClock, **options: object) -> UsbCamera:
    return UsbCamera(UsbCamera.Options(**{"allow_inferred": True, **options}), clock)


def started(clock: VirtualClock, **options: object) -> UsbCamera:
    opened = camera(clock, **options)
    opened.open()
    opened.start()
    return opened
