"""Which SwissRanger cameras are plugged in."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import usb.backend
import usb.backend.libusb1
import usb.core
import usb.util

from drivers.errors import NotAvailableError
from drivers.usb.profile import Profile, shipped_profiles

SYSFS = Path("/sys/bus/usb/devices")


def libusb() -> usb.backend.IBackend:
    """A new context of libusb, the system's or else the one from PyPI.

    A context lists the bus once and then trusts the kernel's hotplug messages, which do not reach every
    container: a camera that was plugged in again would never be seen. A new one lists the bus itself.

    Raises:
        NotAvailableError: there is no libusb.
    """
    import libusb_package

    loaded = usb.backend.libusb1.get_backend(find_library=libusb_package.find_library)
    if loaded is None:
        raise NotAvailableError("libusb-1.0 cannot be loaded: install the package libusb-1.0-0 (Debian)")
    return type(loaded)(loaded.lib)


@dataclass(frozen=True, eq=False)
class UsbDevice:
    """A camera on the bus, not opened.

    Attributes:
        handle: pyusb's device.
        profiles: models that share its id; one, except for the SR2.
        vendor, product: ids.
        bus, address: where it is now; the address changes with each plugging.
        port: socket, stable over plugging, for example `1-2.3`.
        serial: serial number descriptor, or None where it has none or it cannot be read.
    """

    handle: Any
    profiles: tuple[Profile, ...]
    vendor: int
    product: int
    bus: int
    address: int
    port: str
    serial: str | None

    @property
    def model(self) -> str:
        return " or ".join(profile.model for profile in self.profiles)

    @property
    def node(self) -> Path:
        """Device file that must be readable and writable (Linux)."""
        return Path(f"/dev/bus/usb/{self.bus:03d}/{self.address:03d}")

    @property
    def udev_rule(self) -> str:
        """The udev line that gives people at this machine, and group plugdev, access."""
        ids = f'ATTR{{idVendor}}=="{self.vendor:04x}", ATTR{{idProduct}}=="{self.product:04x}"'
        return f'SUBSYSTEM=="usb", {ids}, MODE="0660", GROUP="plugdev", TAG+="uaccess"'

    def __str__(self) -> str:
        text = f"{self.model} ({self.vendor:04x}:{self.product:04x}) at USB {self.port}"
        return f"{text}, serial {self.serial}" if self.serial else text


def find_cameras(extra: Profile | None = None) -> list[UsbDevice]:
    """Cameras whose vendor AND product ids are in a shipped profile, or in the one given, by port."""
    profiles = [*shipped_profiles(), *([extra] if extra is not None else [])]
    found = [_describe(handle, profiles) for handle in _enumerate(profiles)]
    return sorted(found, key=lambda device: device.port)


def _enumerate(profiles: list[Profile]) -> Iterator[Any]:
    ids = {(known.vendor, known.product) for profile in profiles for known in profile.ids}
    try:
        yield from usb.core.find(
            find_all=True,
            backend=libusb(),
            custom_match=lambda device: (device.idVendor, device.idProduct) in ids,
        )
    except usb.core.USBError as error:
        raise NotAvailableError(f"the USB bus cannot be listed: {error}") from error


def _describe(handle: Any, profiles: list[Profile]) -> UsbDevice:
    key = (handle.idVendor, handle.idProduct)
    ports = ".".join(map(str, handle.port_numbers or ()))
    port = f"{handle.bus}-{ports or handle.address}"
    return UsbDevice(
        handle=handle,
        profiles=tuple(p for p in profiles if key in {(known.vendor, known.product) for known in p.ids}),
        vendor=handle.idVendor,
        product=handle.idProduct,
        bus=handle.bus or 0,
        address=handle.address or 0,
        port=port,
        serial=_serial(handle, port),
    )


def _serial(handle: Any, port: str) -> str | None:
    if not handle.iSerialNumber:
        return None
    # sysfs shows what the kernel read at plugging: no traffic, and no permission needed
    if sys.platform == "linux" and (attribute := SYSFS / port / "serial").is_file():
        return attribute.read_text(errors="replace").strip() or None
    try:
        return handle.serial_number or None
    except (usb.core.USBError, ValueError, NotImplementedError):
        return None
    finally:
        usb.util.dispose_resources(handle)
