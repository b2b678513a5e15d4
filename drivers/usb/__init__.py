"""SwissRanger cameras over plain USB, without the vendor's library."""

from drivers.usb.camera import UsbCamera

__all__ = ["UsbCamera"]
