"""The vendor's library, libMesaSR: where it may be loaded from, and the signature of each function.

Signatures follow the vendor's headers (1.0.14; of 2008 for `SR_SetAutoIllumination`, of 2007 for
`SR_SetSaturationThreshold`, which later libraries export without declaring it); functions whose signature is
not public are not declared and so cannot be called.
"""

import ctypes
import logging
import os
import sys
from collections import deque
from ctypes import POINTER, c_char_p, c_float, c_int, c_uint, c_ushort, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

from drivers.errors import InitialisationError, NotAvailableError

log = logging.getLogger(__name__)

c_ubyte = ctypes.c_ubyte

FOLDERS = (
    [Path(os.environ.get("SYSTEMROOT", r"C:\Windows")) / "System32"]
    if sys.platform == "win32"
    else [Path(p) for p in ("/usr/lib", "/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/usr/local/lib")]
)
"""System folders, which only an administrator can write to. The current folder is never searched."""

NAMES = (
    ("libMesaSR.dll",)
    if sys.platform == "win32"
    else ("libmesasr.so", "libmesasr.so.1.0.14", "libmesasr.so.1.0.14.706", "libusbSR.so")
)

INSTALLER_WARNING = (
    "Never run a copy of the Windows installer SwissrangerSetup1.0.14.706.exe from elsewhere: the one on the "
    "vendor's own site carried the Havex trojan"
)

Callback = ctypes.CFUNCTYPE(c_int, c_void_p, c_uint, c_uint, c_void_p)

MESSAGE_TEXT, MESSAGES_BUFFERS = 1, (0x10, 0x11)
"""Callback messages: a line of text; image buffers are about to move, or have moved."""

LEVELS = {0: logging.DEBUG, 1: logging.INFO, 2: logging.WARNING, 3: logging.ERROR}
"""Severity, in the low byte of a text message's parameter."""

SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "SR_GetVersion": (c_int, (POINTER(c_ushort),)),
    "SR_OpenUSB": (c_int, (POINTER(c_void_p), c_uint)),
    "SR_OpenETH": (c_int, (POINTER(c_void_p), c_char_p)),
    "SR_Close": (c_int, (c_void_p,)),
    "SR_SetMode": (c_int, (c_void_p, c_int)),
    "SR_GetMode": (c_int, (c_void_p,)),
    "SR_Acquire": (c_int, (c_void_p,)),
    "SR_GetRows": (c_uint, (c_void_p,)),
    "SR_GetCols": (c_uint, (c_void_p,)),
    "SR_GetImage": (c_void_p, (c_void_p, c_ubyte)),
    "SR_GetImageList": (c_int, (c_void_p, POINTER(c_void_p))),
    "SR_CoordTrfPntFlt": (
        c_int,
        (
            c_void_p,
            POINTER(c_ubyte),
            POINTER(c_ubyte),
            POINTER(c_ushort),
            POINTER(c_float),
            POINTER(c_float),
            POINTER(c_float),
            c_int,
        ),
    ),
    "SR_SetIntegrationTime": (c_int, (c_void_p, c_ubyte)),
    "SR_GetIntegrationTime": (c_ubyte, (c_void_p,)),
    "SR_SetAmplitudeThreshold": (c_int, (c_void_p, c_ushort)),
    "SR_GetAmplitudeThreshold": (c_ushort, (c_void_p,)),
    "SR_SetModulationFrequency": (c_int, (c_void_p, c_int)),
    "SR_GetModulationFrequency": (c_int, (c_void_p,)),
    "SR_SetSaturationThreshold": (c_int, (c_void_p, c_ushort)),
    "SR_SetDualIntegrationTime": (c_int, (c_void_p, c_int)),
    "SR_GetReg": (c_ubyte, (c_void_p, c_ubyte)),
    "SR_SetAutoIllumination": (c_int, (c_void_p, c_ubyte, c_ubyte, c_ubyte, c_ubyte)),
    "SR_SetAutoExposure": (c_int, (c_void_p, c_ubyte, c_ubyte, c_ubyte, c_ubyte)),
    "SR_SetTimeout": (None, (c_void_p, c_int)),
    "SR_ReadSerial": (c_uint, (c_void_p,)),
    "SR_GetDeviceString": (c_int, (c_void_p, c_char_p, c_int)),
    "SR_SetCallback": (c_void_p, (Callback,)),
}
"""Name → result and arguments. A handle is a pointer: as an `int` it would lose its upper half on 64 bit."""

NEEDED = (
    "SR_OpenUSB", "SR_Close", "SR_SetMode", "SR_Acquire", "SR_GetRows", "SR_GetCols", "SR_GetImage",
    "SR_SetIntegrationTime", "SR_GetIntegrationTime", "SR_GetModulationFrequency",
)  # fmt: skip
"""Functions without which no frame can be taken; each of the others is asked for with `has`."""


class Library:
    """A loaded library. Its text messages go to the log, and the last of them into error messages.

    Args:
        path: absolute path of the file.

    Raises:
        NotAvailableError: it cannot be loaded, or lacks a function that is needed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.moves = 0
        self._texts: deque[str] = deque(maxlen=3)
        try:
            self._functions = ctypes.CDLL(str(path))
        except OSError as error:
            raise NotAvailableError(
                f"{path} cannot be loaded: {error}. It is made for x86 processors and needs libusb-0.1.so.4 "
                "(Debian: apt install libusb-0.1-4)"
            ) from error
        for name, (result, arguments) in SIGNATURES.items():
            if self.has(name):
                function = getattr(self._functions, name)
                function.restype, function.argtypes = result, arguments
        if missing := [name for name in NEEDED if not self.has(name)]:
            raise NotAvailableError(f"{path} is no libMesaSR of 2008 or later: it lacks {', '.join(missing)}")
        self._callback = Callback(self._message)  # kept alive as long as the library may call it
        if self.has("SR_SetCallback"):
            self.call("SR_SetCallback", self._callback)

    def has(self, name: str) -> bool:
        """Whether this build exports a function."""
        return hasattr(self._functions, name)

    def call(self, name: str, *arguments: Any) -> Any:
        """Call one of the declared functions; Python's other threads run meanwhile."""
        assert name in SIGNATURES, name
        return getattr(self._functions, name)(*arguments)

    @property
    def version(self) -> tuple[int, ...] | None:
        """Four numbers, the most significant first, or None where the library cannot tell."""
        if not self.has("SR_GetVersion"):
            return None
        numbers = (c_ushort * 4)()
        return tuple(reversed(numbers)) if self.call("SR_GetVersion", numbers) == 0 else None

    def explain(self) -> str:
        """What the library said last, to be added to an error message; it is said once."""
        texts = "; ".join(self._texts)
        self._texts.clear()
        return f" (the library says: {texts})" if texts else ""

    def _message(self, _handle: int | None, message: int, parameter: int, data: int | None) -> int:
        if message == MESSAGE_TEXT and data:
            text = (ctypes.string_at(data) or b"").decode(errors="replace").strip()
            log.log(LEVELS.get(parameter & 0xFF, logging.INFO), "libMesaSR: %s", text)
            if parameter & 0xFF >= 2:
                self._texts.append(text)
        elif message in MESSAGES_BUFFERS:
            self.moves += 1
        return 0


def find_library(explicit: Path | None = None) -> Path:
    """The file to load: the one named, else the first in the system's folders.

    Raises:
        InitialisationError: the name is not absolute, so that it would depend on the current folder.
        NotAvailableError: there is no such file.
    """
    if explicit is not None:
        if not explicit.is_absolute():
            raise InitialisationError(f"library {explicit}: give its absolute path")
        candidates = [explicit]
    else:
        candidates = [folder / name for folder in FOLDERS for name in NAMES]
    for path in candidates:
        if path.is_file():
            return path.resolve()
    where = str(explicit) if explicit is not None else ", ".join(map(str, FOLDERS))
    raise NotAvailableError(
        f"the vendor's library {NAMES[0]} is not in {where}. Install the vendor's Linux package, or name the "
        f"file with the option `library`. {INSTALLER_WARNING}"
    )


@cache
def load_library(path: Path) -> Library:
    """A library, loaded once: its callback is global, so that two wrappers would steal each other's."""
    return Library(path)
