"""The summary at the end of a whole MCAP file: what it repeats, and where its records lie."""

import os
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, McapRecord, MetadataIndex, Schema, Statistics

from drivers.recording.records import RECORD_HEADER, decode

MAGIC = b"\x89MCAP0\r\n"

_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)
_LARGEST = 64 << 20
"""Bytes of a summary: that of an hour at 50 frames/s has some 20 MB."""

_READ = frozenset(
    {
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.STATISTICS,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.METADATA_INDEX,
    }
)


@dataclass
class Index:
    """The summary of a file.

    Attributes:
        start: where it begins.
        known: schemas, channels and statistics.
        offsets: where chunks, attachments and metadata begin.
    """

    start: int
    known: list[McapRecord] = field(default_factory=list)
    offsets: list[int] = field(default_factory=list)


def has_footer(path: Path) -> bool:
    """Whether a file ends as it should; one does not whose writer was killed, or that was cut.

    Nothing but its last bytes is read.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return _read_footer(file, file.seek(0, os.SEEK_END)) is not None


def read_index(file: BinaryIO, size: int) -> Index | None:
    """The summary of a file that ends as it should, checksum compared; None otherwise."""
    footer = _read_footer(file, size)
    if footer is None:
        return None
    _, _, start, _, checksum = _FOOTER.unpack(footer)
    if start == 0:
        return Index(size - _TAIL)
    if size - _TAIL - start > _LARGEST:
        return None
    file.seek(start)
    content = file.read(size - _TAIL - start)
    if checksum and zlib.crc32(footer[:-4], zlib.crc32(content)) != checksum:
        return None
    index, position = Index(start), 0
    try:
        while position < len(content):
            opcode, length = RECORD_HEADER.unpack_from(content, position)
            begin = position + RECORD_HEADER.size
            position = begin + length
            _note(index, opcode, content[begin:position], length)
    except Exception:  # as for other records
        return None
    return index


def _read_footer(file: BinaryIO, size: int) -> bytes | None:
    if size < len(MAGIC) + _TAIL:
        return None
    file.seek(size - _TAIL)
    footer, magic = file.read(_FOOTER.size), file.read()
    opcode, length, start, _, _ = _FOOTER.unpack(footer)
    is_one = magic == MAGIC and opcode == Opcode.FOOTER and length == 20 and start <= size - _TAIL
    return footer if is_one else None


def _note(index: Index, opcode: int, content: bytes, length: int) -> None:
    if len(content) < length:
        raise ValueError("a record goes beyond the summary")
    if opcode not in _READ:
        return
    match decode(opcode, content):
        case ChunkIndex() as found:
            index.offsets.append(found.chunk_start_offset)
        case AttachmentIndex() | MetadataIndex() as found:
            index.offsets.append(found.offset)
        case (Schema() | Channel() | Statistics()) as found:
            index.known.append(found)
