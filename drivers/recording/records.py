"""Single records of an MCAP file: decoded within their bounds, chunks opened with bounded memory.

Layout: https://mcap.dev/spec. A record may be longer than what is known of it: later versions of the format
add fields at its end.
"""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

RECORD_HEADER = struct.Struct("<BQ")
"""Opcode and length before each record's content."""

MESSAGE_HEADER = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time before each message's payload."""

MOST_AT_ONCE = 256 << 20
"""Bytes of a record, or of an opened chunk, that are taken into memory; usual chunks have some MB."""

_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.MESSAGE_INDEX: MessageIndex.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.STATISTICS: Statistics.read,
}

LONGEST_ATTACHMENT_HEAD = 1 << 17
"""Bytes of an attachment that are looked at for its name and media type."""

_LAST_OF_TODAY = 0x0F
"""Opcodes above are of later versions of the format or, from 0x80, private: neither is read here."""


class StoredMessage(NamedTuple):
    """A message and where its payload lies: from `start` to `end` in a chunk's content, or in the file."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class OpenedChunk:
    """What a chunk holds.

    Attributes:
        content: uncompressed.
        compression, packed_size: how it lies in the file, in bytes.
        is_checked: whether it has a checksum, which then agrees.
    """

    content: bytes = field(repr=False)
    compression: str
    packed_size: int
    is_checked: bool
    definitions: list[Schema | Channel]
    messages: list[StoredMessage]


@dataclass(frozen=True, slots=True)
class AttachmentEntry:
    """An attached file: all but its content, of which it is said where it lies. Times in ns."""

    name: str
    media_type: str
    log_time: int
    create_time: int
    data_offset: int
    size: int


class _Content(ReadDataStream):
    """The fields of one record; the library's own stream gives less than asked for at its end."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._left = len(content)

    def read(self, length: int) -> bytes:
        if length > self._left:
            raise ValueError("it is shorter than its fields")
        self._left -= length
        return super().read(length)


def decode(opcode: int, content: bytes) -> McapRecord:
    """One record of a kind other than message, chunk and attachment; raises whatever garbage leads to."""
    return _READERS[opcode](_Content(content))


def open_chunk(content: bytes) -> OpenedChunk:
    """Open a chunk record.

    Raises:
        Exception: what it holds cannot be read: garbage makes each decompressor fail in its own way.
    """
    chunk = Chunk.read(_Content(content))
    opened = _unpacked(chunk)
    if len(opened) != chunk.uncompressed_size:
        raise ValueError(f"it should hold {chunk.uncompressed_size:,} bytes, {_amount(chunk, opened)}")
    if chunk.uncompressed_crc and zlib.crc32(opened) != chunk.uncompressed_crc:
        raise ValueError("checksum does not match")
    definitions, messages = _split(opened)
    return OpenedChunk(
        opened, chunk.compression, len(chunk.data), bool(chunk.uncompressed_crc), definitions, messages
    )


def attachment_entry(content: bytes, start: int) -> AttachmentEntry | None:
    """The head of an attachment whose record's content begins at `start`; None where it is none."""
    try:
        log_time, create_time, length = struct.unpack_from("<QQI", content)
        name = content[20 : 20 + length]
        (second,) = struct.unpack_from("<I", content, 20 + length)
        media_type = content[24 + length : 24 + length + second]
        (size,) = struct.unpack_from("<Q", content, 24 + length + second)
        offset = start + 32 + length + second
        return AttachmentEntry(name.decode(), media_type.decode(), log_time, create_time, offset, size)
    except (struct.error, UnicodeDecodeError):
        return None


def stored_message(content: bytes | memoryview, start: int, end: int, offset: int = 0) -> StoredMessage:
    """The message whose record's content lies from `start` to `end`; its place is moved by `offset`."""
    if end - start < MESSAGE_HEADER.size:
        raise ValueError("a message is shorter than its fields")
    channel, sequence, log_time, publish_time = MESSAGE_HEADER.unpack_from(content, start)
    begin = start + MESSAGE_HEADER.size + offset
    return StoredMessage(channel, sequence, log_time, publish_time, begin, end + offset)


def _split(content: bytes) -> tuple[list[Schema | Channel], list[StoredMessage]]:
    definitions: list[Schema | Channel] = []
    messages: list[StoredMessage] = []
    position, size = 0, len(content)
    while position < size:
        if size - position < RECORD_HEADER.size:
            raise ValueError("its records do not fill it")
        opcode, length = RECORD_HEADER.unpack_from(content, position)
        start = position + RECORD_HEADER.size
        position = start + length
        if position > size:
            raise ValueError("its records do not fill it")
        if opcode == Opcode.MESSAGE:
            messages.append(stored_message(content, start, position))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definition: Any = decode(opcode, content[start:position])
            definitions.append(definition)
        elif opcode <= _LAST_OF_TODAY:
            raise ValueError(f"a record of kind {opcode} cannot be part of it")
    return definitions, messages


def _unpacked(chunk: Chunk) -> bytes:
    """The content of a chunk, at most a byte more than it says it holds."""
    if chunk.uncompressed_size > MOST_AT_ONCE:
        raise ValueError(
            f"it holds {chunk.uncompressed_size:,} bytes, more than the {MOST_AT_ONCE:,} that are read at "
            "once"
        )
    match chunk.compression:
        case "":
            return chunk.data
        case "zstd":
            return _unpack_zstd(chunk.data, chunk.uncompressed_size + 1)
        case "lz4":
            return _unpack_lz4(chunk.data, chunk.uncompressed_size + 1)
    raise ValueError(f"compression {chunk.compression!r} cannot be read here; known are none, lz4 and zstd")


def _unpack_zstd(data: bytes, most: int) -> bytes:
    """All frames of the data one after the other; the plain call of the library reads the first alone."""
    with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
        return stream.read(most)


def _unpack_lz4(data: bytes, most: int) -> bytes:
    parts: list[bytes] = []
    while data and most > 0:
        decompressor = lz4.frame.LZ4FrameDecompressor()
        parts.append(decompressor.decompress(data, max_length=most))
        most -= len(parts[-1])
        data = decompressor.unused_data or b""
    return b"".join(parts)


def _amount(chunk: Chunk, opened: bytes) -> str:
    return "it holds more" if len(opened) > chunk.uncompressed_size else f"only {len(opened):,} can be read"
