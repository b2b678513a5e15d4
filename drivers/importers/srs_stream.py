"""The container of the vendor's streams (`.srs`): objects of an id, a size and a payload.

Layout after the source code that the vendor published with its Linux package.
"""

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from drivers.errors import RecordingError
from drivers.importers.exposure import Findings

SIGNATURES = (b"srIO", b"OIrs")
"""The same constant as compilers of either habit lay it down."""

VERSION = 1
INIT, CONFIGURE, FRAME, CALIBRATION = 1, 2, 3, 4
USER = 0x8000_0000
"""Ids from here on are the users' own."""

HEADER = 8
SIZES = {INIT: 12, CONFIGURE: 64}
"""Bytes of payload of the objects that have one size."""

LARGEST = 1 << 20
"""Bytes of payload that are read; the largest frame has a tenth of it."""


@dataclass(frozen=True, slots=True)
class Object:
    """One object.

    Attributes:
        at: byte at which it begins.
        size: bytes of its payload.
        payload: empty where `size` is more than a frame or a calibration can have.
    """

    kind: int
    at: int
    size: int
    payload: bytes


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """The stream, behind its header; raises `RecordingError` where it is none."""
    if path.exists() and not path.is_file():
        raise RecordingError(f"{path}: is not an ordinary file; name a .srs stream")
    try:
        file = path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); name a .srs stream") from error
    with file:
        header = file.read(8)
        signature, version = header[:4], int.from_bytes(header[4:], "little")
        if signature not in SIGNATURES or version != VERSION:
            said = f"version {version}" if signature in SIGNATURES else f"begins with {_hex(header)}"
            raise RecordingError(
                f"{path}: is not a .srs stream of version {VERSION} ({said}): name another file"
            )
        yield file


def objects(path: Path, file: BinaryIO, findings: Findings) -> Iterator[Object]:
    """The objects of an open stream; it ends where it is torn, and that is noted as lost."""
    end = os.fstat(file.fileno()).st_size
    unknown: set[int] = set()
    while header := file.read(HEADER):
        at = file.tell() - len(header)
        kind, whole = struct.unpack("<II", header) if len(header) == HEADER else (0, 0)
        size = whole - HEADER
        if size < 0 or at + whole > end or size != SIZES.get(kind, size):
            findings.lost.append(
                f"{path}: torn or garbled at byte {at + len(header):,}: all before was read, nothing after"
            )
            return
        if kind not in (INIT, CONFIGURE, FRAME, CALIBRATION) and kind < USER and kind not in unknown:
            unknown.add(kind)
            findings.lost.append(f"{path}: an object of unknown id {kind} at byte {at:,} was passed over")
        payload = file.read(size) if size <= LARGEST else b""
        file.seek(at + whole)
        yield Object(kind, at, size, payload)


def _hex(header: bytes) -> str:
    return header.hex(" ") or "nothing"
