"""What is plugged in, for people: cameras on USB and serial ports that a stage may be on.

Nothing is opened and nothing is sent: opening a serial port alone can reset a stage.
"""

import os
from typing import Literal

from pydantic import BaseModel, ConfigDict

from drivers.errors import InitialisationError, NotAvailableError
from drivers.mesasr.library import find_library
from drivers.usb.discovery import UsbDevice, find_cameras
from drivers.usb.profile import Profile, require_usable

Permission = Literal["granted", "denied", "unknown"]

SERIAL_STAGES = "ptu, grbl, dynamixel"
"""Backends of stages on serial ports; which of them is connected cannot be told without sending to it."""


class FoundDevice(BaseModel):
    """One device.

    Attributes:
        backend: which backend drives it; for a camera, how.
        where: USB socket or serial port.
        remedy: what to do before it can be used, or None.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["camera", "serial port"]
    model: str
    serial: str | None
    where: str
    backend: str
    permission: Permission
    remedy: str | None = None


def list_cameras() -> list[FoundDevice]:
    """SwissRangers on USB; raises `NotAvailableError` where libusb cannot be loaded."""
    has_library = vendor_library_problem() is None
    return [_camera(device, has_library) for device in find_cameras()]


def list_serial_ports() -> list[FoundDevice]:
    """Serial ports of this machine, as far as something is behind them."""
    from serial.tools import list_ports

    return [
        FoundDevice(
            kind="serial port",
            model=port.product or port.description,
            serial=port.serial_number,
            where=port.device,
            backend=SERIAL_STAGES,
            permission=_permission(port.device),
            remedy=None if _permission(port.device) != "denied" else _PORT_REMEDY,
        )
        for port in sorted(list_ports.comports())
    ]


def vendor_library_problem() -> str | None:
    """Why the vendor's library cannot be used, or None where it is there."""
    try:
        find_library()
    except NotAvailableError as error:
        return str(error)
    return None


def _camera(device: UsbDevice, has_library: bool) -> FoundDevice:
    permission = _permission(str(device.node))
    remedy = None
    if permission == "denied":
        remedy = f"put into /etc/udev/rules.d/60-lidarboost.rules and plug in again: {device.udev_rule}"
    elif not has_library:
        remedy = _usb_remedy(device.profiles)
    return FoundDevice(
        kind="camera",
        model=device.model,
        serial=device.serial,
        where=f"USB {device.port}",
        backend="mesasr" if has_library else "usb",
        permission=permission,
        remedy=remedy,
    )


def _usb_remedy(profiles: tuple[Profile, ...]) -> str | None:
    if len(profiles) > 1:
        return f"set model to {' or '.join(profile.model for profile in profiles)}"
    try:
        require_usable(profiles[0], allow_inferred=False)
    except InitialisationError as error:
        return str(error)
    return None


def _permission(path: str) -> Permission:
    if os.name != "posix" or not os.path.exists(path):  # noqa: PTH110
        return "unknown"
    return "granted" if os.access(path, os.R_OK | os.W_OK) else "denied"


_PORT_REMEDY = "sudo usermod -aG dialout $USER, then log in again"
