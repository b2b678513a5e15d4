"""Opening and closing a camera through the vendor's library, and what it says of itself."""

import ctypes
import logging
import re
from ctypes import c_void_p

from drivers.errors import NotAvailableError
from drivers.mesasr.library import Library

log = logging.getLogger(__name__)

NO_SERIAL = 0xFFFFFFFF

DEVICE_STRING_BYTES = 512

CLOSE_ERRORS = {
    -1: "wrong device",
    -2: "the interface could not be released",
    -3: "the device could not be closed",
}
"""Results of SR_Close (vendor header)."""


def connect(library: Library, address: str | None, serial: str | None) -> c_void_p:
    """Open the camera at an IP address, else that on USB with a serial number (hexadecimal), else the first.

    Raises:
        NotAvailableError: there is none, or it may not be opened.
    """
    handle = c_void_p()
    if address is not None:
        if not library.has("SR_OpenETH"):
            raise NotAvailableError(f"{library.path} cannot open cameras on Ethernet")
        target = f"at {address}"
        opened = library.call("SR_OpenETH", ctypes.byref(handle), address.encode())
    else:
        number = int(serial or "0", 16)
        target = f"with serial {serial}" if number else "on USB"
        opened = library.call("SR_OpenUSB", ctypes.byref(handle), number)
    if opened <= 0 or not handle.value:
        raise NotAvailableError(
            f"libMesaSR found no camera {target}, or may not open it (result {opened})"
            f"{library.explain()}; look at `lidarboost devices` for ids and permissions"
        )
    return handle


def disconnect(library: Library, handle: c_void_p) -> None:
    """Close the camera; what fails is logged."""
    status = library.call("SR_Close", handle)
    if status < 0:
        log.warning("SR_Close: %s", CLOSE_ERRORS.get(status, f"failed with {status}"))


def product_of(library: Library, handle: c_void_p) -> int | None:
    """USB product id, or None where the library cannot tell."""
    if not library.has("SR_GetDeviceString"):
        return None
    text = ctypes.create_string_buffer(DEVICE_STRING_BYTES)
    if library.call("SR_GetDeviceString", handle, text, DEVICE_STRING_BYTES) <= 0:
        return None
    match = re.search(rb"ProductID:0x([0-9a-fA-F]+)", text.value)
    return int(match[1], 16) if match else None


def serial_of(library: Library, handle: c_void_p) -> str | None:
    """Serial number, eight hexadecimal digits, or None where there is none."""
    if not library.has("SR_ReadSerial"):
        return None
    serial = library.call("SR_ReadSerial", handle)
    return None if serial == NO_SERIAL else f"{serial:08X}"
