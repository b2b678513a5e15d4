"""Copying records of one MCAP file into another, byte for byte, with an index of their new places."""

import struct
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from drivers.errors import RecordingError
from drivers.recording.container import Located
from drivers.recording.index import MAGIC
from drivers.recording.output import Output
from drivers.recording.records import (
    MESSAGE_HEADER,
    RECORD_HEADER,
    AttachmentEntry,
    OpenedChunk,
    StoredMessage,
)
from drivers.recording.versions import library

_BLOCK = 1 << 20
_MESSAGE_OVERHEAD = RECORD_HEADER.size + MESSAGE_HEADER.size
"""Bytes of a message's record before its payload."""


class Copy:
    """A file that takes over records of another; whole when the context ends, discarded after an error.

    Args:
        source: the file that records come from.
        path: of the new one.
        profile: MCAP profile of the new one.

    Raises:
        StorageError: the file cannot be written.
    """

    def __init__(self, source: BinaryIO, path: Path, profile: str) -> None:
        self._source = source
        self._output = Output(path)
        self._checksum = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._times: tuple[int, int] | None = None
        self._index: list[ChunkIndex | AttachmentIndex | MetadataIndex] = []
        try:
            self._write(MAGIC)
            self._put(Header(profile=profile, library=library()))
        except BaseException:
            self._output.discard()
            raise

    @property
    def messages(self) -> int:
        """Messages written so far."""
        return self._counts.total()

    def define(self, schemas: Iterable[Schema], channels: Iterable[Channel]) -> None:
        """Write definitions; a channel whose schema is not among them has none."""
        for schema in schemas:
            self._schemas[schema.id] = schema
            self._put(schema)
        for channel in channels:
            if channel.schema_id not in self._schemas:
                channel = replace(channel, schema_id=0)
            self._channels[channel.id] = channel
            self._put(channel)

    def chunk(self, item: Located, chunk: OpenedChunk, kept: Sequence[StoredMessage]) -> None:
        """Take over a chunk; it is packed anew where it holds messages or definitions that are not wanted."""
        if len(kept) < len(chunk.messages) or any(map(self._is_other, chunk.definitions)):
            self._pack(chunk, kept)
            return
        offset = self._output.tell()
        self._take(item)
        entry = _chunk_index(offset, item.length, chunk.compression, chunk.packed_size, len(chunk.content))
        self._finish_chunk(entry, kept)

    def message(self, item: Located, message: StoredMessage) -> None:
        """Take over a message that is in no chunk."""
        self._count([message])
        self._take(item)

    def other(self, item: Located) -> None:
        """Take over an attachment, metadata, or a record of a kind not known here; nothing else needs it."""
        offset = self._output.tell()
        match item.record:
            case AttachmentEntry() as found:
                entry = AttachmentIndex(
                    offset=offset,
                    length=item.length,
                    log_time=found.log_time,
                    create_time=found.create_time,
                    data_size=found.size,
                    name=found.name,
                    media_type=found.media_type,
                )
                self._index.append(entry)
            case Metadata() as found:
                self._index.append(MetadataIndex(offset=offset, length=item.length, name=found.name))
            case None:
                pass
            case _:
                return
        self._take(item)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._output.discard()
            return
        try:
            self._end()
            self._output.finish()
        except BaseException:
            self._output.discard()
            raise

    def _is_other(self, definition: Schema | Channel) -> bool:
        known: Schema | Channel | None
        if isinstance(definition, Channel):
            known = self._channels.get(definition.id)
        else:
            known = self._schemas.get(definition.id)
        return definition != known

    def _pack(self, chunk: OpenedChunk, kept: Sequence[StoredMessage]) -> None:
        """A chunk of some messages of another; the definitions stand at the file's beginning."""
        if not kept:
            return
        content, moved = bytearray(), []
        for message in kept:
            begin = len(content) + _MESSAGE_OVERHEAD
            content += chunk.content[message.start - _MESSAGE_OVERHEAD : message.end]
            moved.append(message._replace(start=begin, end=len(content)))
        packed = zstandard.compress(bytes(content))
        times = [message.log_time for message in kept]
        offset = self._output.tell()
        self._put(
            Chunk(
                compression="zstd",
                data=packed,
                message_start_time=min(times),
                message_end_time=max(times),
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=len(content),
            )
        )
        entry = _chunk_index(offset, self._output.tell() - offset, "zstd", len(packed), len(content))
        self._finish_chunk(entry, moved)

    def _finish_chunk(self, entry: ChunkIndex, messages: Sequence[StoredMessage]) -> None:
        """Write the message indexes of the chunk just written, and remember its own."""
        by_channel: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
        for message in messages:
            by_channel[message.channel].append((message.log_time, message.start - _MESSAGE_OVERHEAD))
        begin = self._output.tell()
        for channel, records in by_channel.items():
            entry.message_index_offsets[channel] = self._output.tell()
            self._put(MessageIndex(channel_id=channel, records=records))
        entry.message_index_length = self._output.tell() - begin
        times = [message.log_time for message in messages]
        entry.message_start_time, entry.message_end_time = min(times, default=0), max(times, default=0)
        self._index.append(entry)
        self._count(messages)

    def _count(self, messages: Sequence[StoredMessage]) -> None:
        for message in messages:
            self._counts[message.channel] += 1
            first, last = self._times or (message.log_time, message.log_time)
            self._times = min(first, message.log_time), max(last, message.log_time)

    def _take(self, item: Located) -> None:
        """Copy a record's own bytes, in blocks."""
        self._source.seek(item.offset)
        left = item.length
        while left:
            block = self._source.read(min(_BLOCK, left))
            if not block:
                raise RecordingError("the recording became shorter while it was copied; try again")
            self._write(block)
            left -= len(block)

    def _put(self, record: McapRecord) -> None:
        builder = RecordBuilder()
        record.write(builder)
        self._write(builder.end())  # type: ignore[no-untyped-call]

    def _write(self, data: bytes) -> None:
        self._output.write(data)
        self._checksum = zlib.crc32(data, self._checksum)

    def _end(self) -> None:
        """End of data, summary and footer."""
        self._put(DataEnd(self._checksum))
        start, builder = self._output.tell(), RecordBuilder()
        index = sorted(self._index, key=lambda entry: type(entry).__name__)  # the summary is grouped by kind
        for record in (*self._schemas.values(), *self._channels.values(), self._statistics(), *index):
            record.write(builder)
        summary = builder.end()  # type: ignore[no-untyped-call]
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
        self._output.write(summary)
        self._put(Footer(start, 0, zlib.crc32(summary + footer)))
        self._output.write(MAGIC)

    def _statistics(self) -> Statistics:
        first, last = self._times or (0, 0)
        kinds = Counter(type(entry) for entry in self._index)
        return Statistics(
            attachment_count=kinds[AttachmentIndex],
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=kinds[ChunkIndex],
            message_count=self.messages,
            message_end_time=last,
            message_start_time=first,
            metadata_count=kinds[MetadataIndex],
            schema_count=len(self._schemas),
        )


def _chunk_index(offset: int, length: int, compression: str, packed: int, unpacked: int) -> ChunkIndex:
    """The index of a chunk, without what its messages say."""
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=offset,
        compression=compression,
        compressed_size=packed,
        message_end_time=0,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=0,
        uncompressed_size=unpacked,
    )
