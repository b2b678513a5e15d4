"""Walking through an MCAP file record by record, past damage where the format allows, with bounded memory.

The library's own readers end at the first fault and hold whole attachments, so the walk from record to record
is done here.
"""

import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Literal

from mcap.opcode import Opcode
from mcap.records import McapRecord

from drivers.recording.index import MAGIC, read_index
from drivers.recording.records import (
    LONGEST_ATTACHMENT_HEAD,
    MOST_AT_ONCE,
    RECORD_HEADER,
    AttachmentEntry,
    OpenedChunk,
    StoredMessage,
    attachment_entry,
    decode,
    open_chunk,
    stored_message,
)

_DATA_END_SIZE = 4
_BLOCK = 1 << 20

_DATA_KINDS = frozenset(
    {
        Opcode.HEADER,
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.MESSAGE,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
        Opcode.ATTACHMENT,
        Opcode.METADATA,
    }
)
_SUMMARY_KINDS = frozenset(
    {
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.STATISTICS,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
        Opcode.FOOTER,
    }
)
_FIRST_UNKNOWN = 0x10

Part = Literal["end", "chunk", "attachment", "record", "index"]

_PARTS: dict[int, Part] = {
    Opcode.CHUNK: "chunk",
    Opcode.ATTACHMENT: "attachment",
    Opcode.MESSAGE_INDEX: "index",
}


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


@dataclass(frozen=True, slots=True)
class Located:
    """A record, and where it stands in the file, its header included.

    Attributes:
        record: None = of a kind that is not known here, to be kept as it is.
        offset, length: in bytes; 0 where it comes from the index.
    """

    record: McapRecord | AttachmentEntry | OpenedChunk | StoredMessage | None
    offset: int = 0
    length: int = 0


def walk(file: BinaryIO) -> Iterator[Located | Fault]:
    """Every record that can be read, in file order, and a `Fault` for each stretch that cannot.

    Chunks are opened and their checksums compared, as are those of attachments, of the index and of the
    whole. Schemas, channels and statistics of the index come first, so that a damaged first chunk does not
    take them along. The message indexes of a damaged chunk follow its fault: they tell what it held.

    Args:
        file: opened for reading bytes, with `MAGIC` at its start.
    """
    return _Walk(file).items()


class _Walk:
    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, os.SEEK_END)
        self._index = read_index(file, self._size)
        self._checksum = zlib.crc32(MAGIC)
        self._is_whole = True
        self._unknown: list[Fault] = []

    def items(self) -> Iterator[Located | Fault]:
        for record in self._index.known if self._index is not None else ():
            yield Located(record)
        position = len(MAGIC)
        while True:
            opcode, length = self._header(position)
            after = position + RECORD_HEADER.size + length
            if opcode == Opcode.DATA_END and self._is_end(length, after):
                yield from self._ending(position)
                return
            if after > self._size or not (opcode in _DATA_KINDS or opcode >= _FIRST_UNKNOWN):
                resumed = self._next_known(position)
                if resumed is None:
                    yield from self._unknown
                    yield Fault("end", position, self._size - position, self._tear(position, opcode, length))
                    return
                yield Fault("record", position, resumed - position, "its record header is garbled")
                position, self._is_whole = resumed, False
                continue
            self._checksum = zlib.crc32(RECORD_HEADER.pack(opcode, length), self._checksum)
            found = self._read(opcode, position, length)
            self._is_whole &= not isinstance(found, Fault)
            yield found
            position = after

    def _header(self, position: int) -> tuple[int, int]:
        self._file.seek(position)
        header = self._file.read(RECORD_HEADER.size)
        opcode, length = RECORD_HEADER.unpack(header) if len(header) == RECORD_HEADER.size else (0, 0)
        return opcode, length

    def _is_end(self, length: int, after: int) -> bool:
        """Whether an end of data is one, and not another record with a flipped bit: the summary follows."""
        if length < _DATA_END_SIZE or after > self._size:
            return False
        if self._index is not None:
            return after == self._index.start
        self._file.seek(after)
        following = self._file.read(1)
        return not following or following[0] in _SUMMARY_KINDS

    def _read(self, opcode: int, position: int, length: int) -> Located | Fault:
        part = _PARTS.get(opcode, "record")
        start, whole = position + RECORD_HEADER.size, RECORD_HEADER.size + length
        self._file.seek(start)
        if opcode == Opcode.ATTACHMENT:
            attached = self._attachment(start, length)
            if isinstance(attached, str):
                return Fault(part, position, whole, attached)
            return Located(attached, position, whole)
        if opcode >= _FIRST_UNKNOWN:
            self._pass_over(length)
            self._unknown.append(Fault(part, position, whole, f"records of kind {opcode} are not known here"))
            return Located(None, position, whole)
        if length > MOST_AT_ONCE:
            self._pass_over(length)
            return Fault(part, position, whole, f"more than the {MOST_AT_ONCE:,} bytes that are read at once")
        content = self._take(length)
        try:
            return Located(_decoded(opcode, content, start), position, whole)
        except Exception as error:  # garbage makes each decoder fail in its own way, decompressors included
            return Fault(part, position, whole, str(error) or type(error).__name__)

    def _attachment(self, start: int, length: int) -> AttachmentEntry | str:
        """An attachment whose checksum agrees, or what is wrong; its content passes in blocks."""
        head = self._take(min(length, LONGEST_ATTACHMENT_HEAD))
        entry = attachment_entry(head, start)
        if entry is None or entry.data_offset + entry.size + 4 > start + length:
            self._pass_over(length - len(head))
            return "it is shorter than its fields"
        checked = entry.data_offset + entry.size - start
        checksum, taken = zlib.crc32(head[:checked]), len(head)
        tail = head[checked:]
        while taken < length:
            block = self._take(min(_BLOCK, length - taken))
            inside = max(0, checked - taken)
            checksum = zlib.crc32(block[:inside], checksum)
            tail = (tail + block[inside:])[:4]
            taken += len(block)
        stored = int.from_bytes(tail[:4], "little")
        if stored and stored != checksum:
            return f"checksum of {entry.name!r} does not match"
        return entry

    def _take(self, length: int) -> bytes:
        content = self._file.read(length)
        if len(content) != length:
            raise OSError("the file became shorter while it was read")
        self._checksum = zlib.crc32(content, self._checksum)
        return content

    def _pass_over(self, length: int) -> None:
        while length > 0:
            length -= len(self._take(min(_BLOCK, length)))

    def _ending(self, position: int) -> Iterator[Fault]:
        self._file.seek(position + RECORD_HEADER.size)
        stored = int.from_bytes(self._file.read(_DATA_END_SIZE), "little")
        if stored != self._checksum:  # else they were written like that
            yield from self._unknown
        if self._is_whole and stored not in (0, self._checksum):
            yield Fault("index", 0, position, "a record without a checksum of its own has changed")
        if self._index is None:
            yield Fault("index", position, self._size - position, "the index is missing or damaged")

    def _next_known(self, position: int) -> int | None:
        """Where the next record starts of which the index knows; None without an index."""
        if self._index is None:
            return None
        data_end = self._index.start - RECORD_HEADER.size - _DATA_END_SIZE
        return min((offset for offset in [*self._index.offsets, data_end] if offset > position), default=None)

    def _tear(self, position: int, opcode: int, length: int) -> str:
        if self._size - position < RECORD_HEADER.size:
            return "the file ends here, without an index"
        if opcode in _DATA_KINDS or opcode >= _FIRST_UNKNOWN:
            return f"the last record should have {length:,} bytes"
        return f"what follows is not a record (type {opcode})"


def _decoded(opcode: int, content: bytes, start: int) -> McapRecord | OpenedChunk | StoredMessage:
    if opcode == Opcode.CHUNK:
        return open_chunk(content)
    if opcode == Opcode.MESSAGE:
        return stored_message(content, 0, len(content), start)
    return decode(opcode, content)
