"""What a recording holds beside the frames' images, gathered in one pass."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from mcap.records import Attachment, Channel, McapRecord, MessageIndex, Metadata
from mcap.records import Message as MessageRecord
from mcap.records import Schema as SchemaRecord

from drivers.errors import RecordingError
from drivers.messages import FrameFields, Message, Schema
from drivers.recording.assembly import FRAME_TOPICS, FrameAssembler
from drivers.recording.container import MAGIC, Fault, walk

UNKNOWN_TOPIC = "unknown topics"
"""Where messages are counted whose channel was lost."""

_NO_SCHEMA = Schema("", "jsonschema", b"")


@dataclass(frozen=True, slots=True)
class FrameEntry:
    """What is remembered of each frame: all but its images, and their size (rows, columns)."""

    fields: FrameFields
    shape: tuple[int, int]

    @property
    def sequence(self) -> int:
        return self.fields.sequence

    @property
    def timestamp(self) -> int:
        return self.fields.timestamp

    @property
    def burst(self) -> int | None:
        return self.fields.burst

    @property
    def pose(self) -> int | None:
        return self.fields.pose


@dataclass(slots=True)
class TopicEntry:
    """Messages of a topic: how many, and the log times (ns) of the earliest and the latest."""

    schema: Schema
    count: int
    first: int
    last: int


@dataclass
class Contents:
    """Everything but payloads: metadata and attachments by name, topics, frames, and what is wrong."""

    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, Attachment] = field(default_factory=dict)
    topics: dict[str, TopicEntry] = field(default_factory=dict)
    frames: list[FrameEntry] = field(default_factory=list)
    incomplete: list[int] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    lost: Counter[str] = field(default_factory=Counter)

    def note(self, item: McapRecord | Fault) -> None:
        """Remember a record that is no message, or a fault."""
        match item:
            case Metadata():
                self.metadata[item.name] = item.metadata
            case Attachment():
                self.attachments[item.name] = item
            case Fault():
                self.faults.append(item)

    def count(self, message: Message, log_time: int) -> None:
        """Remember that a message was there."""
        entry = self.topics.setdefault(message.topic, TopicEntry(message.schema, 0, log_time, log_time))
        entry.count += 1
        entry.first, entry.last = min(entry.first, log_time), max(entry.last, log_time)


def read_contents(path: Path) -> Contents:
    """Read a file through once, checksums compared.

    Raises:
        RecordingError: not a file that can be read as MCAP, or frames that do not decode.
    """
    check_magic(path)
    contents, assembler = Contents(), FrameAssembler()
    for message, log_time in read_messages(path, contents):
        contents.count(message, log_time)
        if message.topic not in FRAME_TOPICS:
            continue
        try:
            frame = assembler.add(message)
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from error
        if frame is not None:
            contents.frames.append(FrameEntry(FrameFields.of(frame), frame.shape))
    assembler.finish()
    contents.incomplete.extend(assembler.incomplete)
    return contents


def read_messages(path: Path, contents: Contents | None = None) -> Iterator[tuple[Message, int]]:
    """Every message in file order with its log time (ns); all else is noted in `contents`."""
    kept = Contents() if contents is None else contents
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, Schema]] = {}
    with path.open("rb") as file:
        for record in walk(file):
            match record:
                case SchemaRecord():
                    schemas[record.id] = Schema(record.name, cast(Any, record.encoding), record.data)
                case Channel():
                    schema = schemas.get(record.schema_id, _NO_SCHEMA)
                    channels[record.id] = record.topic.removeprefix("/"), schema
                case MessageIndex():  # of a chunk that could not be read
                    topic, _ = channels.get(record.channel_id, (UNKNOWN_TOPIC, _NO_SCHEMA))
                    kept.lost[topic] += len(record.records)
                case MessageRecord() if record.channel_id in channels:
                    topic, schema = channels[record.channel_id]
                    yield (
                        Message(topic, schema, record.data, record.publish_time, record.sequence),
                        record.log_time,
                    )
                case MessageRecord():
                    kept.lost[UNKNOWN_TOPIC] += 1
                case _:
                    kept.note(record)


def check_magic(path: Path) -> None:
    """Raise `RecordingError` unless the file can be opened and begins as MCAP does."""
    try:
        with path.open("rb") as file:
            start = file.read(len(MAGIC))
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read ({error.strerror}); name a recording (.mcap)"
        ) from error
    if not start:
        raise RecordingError(f"{path}: is empty (0 bytes); expected an MCAP recording: record it again")
    if start != MAGIC:
        raise RecordingError(
            f"{path}: is not MCAP (begins with {start.hex(' ')}, expected {MAGIC.hex(' ')}); "
            "name a recording, or make one of camera files with `lidarboost import`"
        )
