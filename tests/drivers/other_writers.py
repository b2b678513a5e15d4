"""Recordings as other programs write them: in other orders and chunks, with records longer than known."""

import struct
import zlib
from dataclasses import dataclass

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)
from mcap.writer import Writer

MAGIC = b"\x89MCAP0\r\n"


def rewrite(source, out, arrange=lambda found: found, extra=lambda _: None, profile="", **options):
    """Copy a recording with the library's writer; `arrange` orders its (schema, channel, message)."""
    with source.open("rb") as read, out.open("wb") as write:
        reader, ids = make_reader(read), {}
        writer = Writer(write, **options)
        writer.start(profile=profile)
        for attached in reader.iter_attachments():
            writer.add_attachment(
                attached.create_time, attached.log_time, attached.name, attached.media_type, attached.data
            )
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for schema, channel, message in arrange(list(reader.iter_messages(log_time_order=False))):
            if channel.topic not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id
                )
            writer.add_message(
                ids[channel.topic],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        extra(writer)
        writer.finish()
    return out


def by_topic(found):
    return sorted(found, key=lambda item: item[1].topic)


def encoded(record, pad=b""):
    """A record's bytes, `pad` added to its content."""
    builder = RecordBuilder()
    record.write(builder)
    plain = builder.end()
    opcode, length = struct.unpack_from("<BQ", plain)
    return struct.pack("<BQ", opcode, length + len(pad)) + plain[9:] + pad


def chunk_bytes(records, compression="zstd", *, checksum=True, packed=None, size=None, pad=b""):
    """A chunk of encoded records; `packed` and `size` say otherwise what it holds."""
    content = b"".join(records)
    if packed is None:
        packed = {
            "": lambda data: data,
            "zstd": zstandard.compress,
            "lz4": lz4.frame.compress,
        }[compression](content)
    return encoded(
        Chunk(
            compression=compression,
            data=packed,
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=zlib.crc32(content) if checksum else 0,
            uncompressed_size=len(content) if size is None else size,
        ),
        pad,
    )


@dataclass
class Parts:
    """The records of a recording, to be put together in other ways."""

    schemas: list[Schema]
    channels: list[Channel]
    messages: list[Message]
    attachments: list[Attachment]
    metadata: list[Metadata]

    @classmethod
    def of(cls, path):
        with path.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            return cls(
                list(summary.schemas.values()),
                list(summary.channels.values()),
                [message for _, _, message in reader.iter_messages(log_time_order=False)],
                list(reader.iter_attachments()),
                list(reader.iter_metadata()),
            )

    @property
    def definitions(self):
        return [*self.schemas, *self.channels]

    def indexes(self, pad=b""):
        """Message indexes of one chunk that holds everything (the offsets are of no use)."""
        counts = {}
        for message in self.messages:
            counts.setdefault(message.channel_id, []).append((message.log_time, 0))
        return b"".join(encoded(MessageIndex(number, records), pad) for number, records in counts.items())

    def statistics(self):
        counts = {}
        for message in self.messages:
            counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
        return Statistics(
            len(self.attachments),
            len(self.channels),
            counts,
            1,
            len(self.messages),
            0,
            0,
            1,
            len(self.schemas),
        )


def assemble(path, data, summary=b"", pad=b""):
    """A file of encoded records, whole: header, data, end of data, summary, footer."""
    content = MAGIC + encoded(Header("", "other"), pad) + data
    content += encoded(DataEnd(zlib.crc32(content)), pad)
    start = len(content) if summary else 0
    footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
    content += summary + encoded(Footer(start, 0, zlib.crc32(summary + footer))) + MAGIC
    path.write_bytes(content)
    return path


def padded(source, out):
    """The same recording with bytes at the end of every record that may grow (conformance feature `pad`)."""
    parts, pad = Parts.of(source), b"\x01\x02\x03"
    data = b"".join(encoded(record, pad) for record in (*parts.attachments, *parts.metadata))
    inside = [encoded(record, pad) for record in parts.definitions]
    data += chunk_bytes(inside + [encoded(message) for message in parts.messages], pad=pad)
    data += parts.indexes(pad)
    known = b"".join(encoded(record, pad) for record in (*parts.definitions, parts.statistics()))
    return assemble(out, data, known, pad)
