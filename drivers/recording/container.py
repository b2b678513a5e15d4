"""Reading an MCAP file record by record, past damage where the format allows.

The library's own readers end at the first fault, so the walk from record to record is done here and the
library only decodes each one. Layout: https://mcap.dev/spec.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO, Literal

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, McapRecord, MessageIndex, Metadata, Schema
from mcap.records import AttachmentIndex as AttachmentIndexRecord
from mcap.records import Message as MessageRecord
from mcap.stream_reader import StreamReader, breakup_chunk

MAGIC = b"\x89MCAP0\r\n"
HEADER_SIZE = 9
"""Opcode (1 byte) and length (8 bytes) before each record's content."""

FOOTER_SIZE = HEADER_SIZE + 20
DATA_END_LENGTH = 4
FIRST_PRIVATE_OPCODE = 0x80

Part = Literal["end", "chunk", "attachment", "record", "index"]


@dataclass(frozen=True, slots=True)
class Fault:
    """A stretch of the file that cannot be read.

    Attributes:
        part: `end` = the file stops short; `index` = only its index does not fit; else what is damaged.
        offset, length: where, in bytes.
        reason: why, in words.
    """

    part: Part
    offset: int
    length: int
    reason: str


@dataclass
class _Index:
    """The summary at the end of a whole file."""

    start: int
    definitions: list[McapRecord] = field(default_factory=list)
    offsets: list[int] = field(default_factory=list)


def walk(file: BinaryIO) -> Iterator[McapRecord | Fault]:
    """Every record that can be read, in file order, and a `Fault` for each stretch that cannot.

    Chunks are opened and their checksums compared, as are those of attachments and of the index. Schemas and
    channels that the index repeats come first, so that a damaged first chunk does not take them along. The
    message indexes of a damaged chunk follow its fault: they tell what it held.

    Args:
        file: opened for reading bytes, with `MAGIC` at its start.
    """
    size = file.seek(0, os.SEEK_END)
    index = _read_index(file, size)
    if index is not None:
        yield from index.definitions
    position, chunk_failed, checksum, whole = len(MAGIC), False, zlib.crc32(MAGIC), True
    while True:
        file.seek(position)
        header = file.read(HEADER_SIZE)
        opcode, length = struct.unpack("<BQ", header) if len(header) == HEADER_SIZE else (0, 0)
        after = position + HEADER_SIZE + length
        if opcode == Opcode.DATA_END and length == DATA_END_LENGTH:
            stored = int.from_bytes(file.read(DATA_END_LENGTH), "little")
            yield from _ending(position, size, index, whole and stored not in (0, checksum))
            return
        if after > size or not _is_known(opcode):
            resumed = _next_known(index, position)
            if resumed is None:
                yield Fault("end", position, size - position, _tear(header, opcode, length))
                return
            yield Fault("record", position, resumed - position, "its record header is garbled")
            position, whole = resumed, False
            continue
        content = file.read(length)
        checksum = zlib.crc32(content, zlib.crc32(header, checksum))
        found = _decode(opcode, content, position)
        if isinstance(found, Fault):
            chunk_failed, whole = found.part == "chunk", False
            yield found
        else:
            chunk_failed = chunk_failed and opcode == Opcode.MESSAGE_INDEX
            yield from (record for record in found if chunk_failed or not isinstance(record, MessageIndex))
        position = after


def _ending(position: int, size: int, index: _Index | None, is_changed: bool) -> Iterator[Fault]:
    if is_changed:
        yield Fault("index", 0, position, "a record without a checksum of its own has changed")
    if index is None:
        yield Fault("index", position, size - position, "the index is missing or damaged")


def _decode(opcode: int, content: bytes, offset: int) -> list[McapRecord] | Fault:
    stream = ReadDataStream(BytesIO(content))
    part: Part = (
        "chunk" if opcode == Opcode.CHUNK else "attachment" if opcode == Opcode.ATTACHMENT else "record"
    )
    try:
        match opcode:
            case Opcode.CHUNK:
                return breakup_chunk(Chunk.read(stream), validate_crc=True)
            case Opcode.ATTACHMENT:
                return [_attachment(content, stream)]
            case Opcode.METADATA:
                return [Metadata.read(stream)]
            case Opcode.SCHEMA:
                return [Schema.read(stream)]
            case Opcode.CHANNEL:
                return [Channel.read(stream)]
            case Opcode.MESSAGE:
                return [MessageRecord.read(stream, len(content))]
            case Opcode.MESSAGE_INDEX:
                return [MessageIndex.read(stream)]
    except Exception as error:  # garbage makes each decoder fail in its own way, decompressors included
        return Fault(part, offset, HEADER_SIZE + len(content), _reason(error))
    return []


def _attachment(content: bytes, stream: ReadDataStream) -> Attachment:
    record: Attachment = Attachment.read(stream)
    stored = int.from_bytes(content[-4:], "little")
    if stored and zlib.crc32(content[:-4]) != stored:  # the library does not compare it
        raise ValueError(f"checksum of {record.name!r} does not match")
    return record


def _read_index(file: BinaryIO, size: int) -> _Index | None:
    """The summary of a file that ends as it should, checksum compared; None otherwise."""
    tail = FOOTER_SIZE + len(MAGIC)
    if size < len(MAGIC) + tail:
        return None
    file.seek(size - tail)
    footer, magic = file.read(FOOTER_SIZE), file.read()
    opcode, length, start, _, checksum = struct.unpack("<BQQQI", footer)
    if magic != MAGIC or opcode != Opcode.FOOTER or length != 20 or start > size - tail:
        return None
    if start == 0:
        return _Index(size - tail)
    file.seek(start)
    content = file.read(size - tail - start)
    if checksum and zlib.crc32(content + footer[:-4]) != checksum:
        return None
    index = _Index(start)
    try:
        for record in StreamReader(BytesIO(content + footer + MAGIC), skip_magic=True).records:
            if isinstance(record, (Schema, Channel)):
                index.definitions.append(record)
            elif isinstance(record, ChunkIndex):
                index.offsets.append(record.chunk_start_offset)
            elif isinstance(record, AttachmentIndexRecord):
                index.offsets.append(record.offset)
    except (McapError, ValueError, struct.error):
        return None
    return index


def _next_known(index: _Index | None, position: int) -> int | None:
    """Where the next record starts of which the index knows; None without an index."""
    if index is None:
        return None
    data_end = index.start - HEADER_SIZE - 4
    return min((offset for offset in [*index.offsets, data_end] if offset > position), default=None)


def _is_known(opcode: int) -> bool:
    """Whether a record of this kind may stand in the data section, before its end."""
    data = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX)
    return opcode >= FIRST_PRIVATE_OPCODE or opcode in (*data, Opcode.ATTACHMENT, Opcode.METADATA)


def _tear(header: bytes, opcode: int, length: int) -> str:
    if len(header) < HEADER_SIZE:
        return "the file ends here, without an index"
    if not _is_known(opcode):
        return f"what follows is not a record (type {opcode})"
    return f"the last record should have {length:,} bytes"


def _reason(error: Exception) -> str:
    if isinstance(error, ImportError):
        return str(error)
    text = str(error)
    return "checksum does not match" if "crc validation" in text else text or type(error).__name__
