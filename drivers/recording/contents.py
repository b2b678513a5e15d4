"""What a recording holds beside the frames' images, gathered in one pass."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

from mcap.records import Channel, Header, MessageIndex, Metadata, Statistics
from mcap.records import Schema as SchemaRecord

from drivers.errors import RecordingError
from drivers.messages import CAMERA_CALIBRATION, FrameFields, Schema
from drivers.recording.assembly import (
    MESSAGE_ENCODINGS,
    FrameAssembler,
    FrameEntry,
    Key,
    Place,
    frame_entry,
    part_of,
)
from drivers.recording.container import Fault, Located, walk
from drivers.recording.index import MAGIC
from drivers.recording.losses import Losses
from drivers.recording.records import AttachmentEntry, OpenedChunk, StoredMessage

_NO_SCHEMA = Schema("", "jsonschema", b"")


class FoundMessage(NamedTuple):
    """A message with the channel it came on and the place of its payload."""

    channel: Channel
    stored: StoredMessage
    place: Place
    payload: bytes

    @property
    def topic(self) -> str:
        """Without leading slash."""
        return self.channel.topic.removeprefix("/")


@dataclass(slots=True)
class TopicEntry:
    """Messages of a topic: their schemas, how many, and the log times (ns) of the earliest and the latest."""

    schemas: list[str]
    count: int
    first: int
    last: int


class InvalidFrame(NamedTuple):
    """A frame whose messages are there, but are not what they should be."""

    sequence: int
    reason: str


class SaidCalibration(NamedTuple):
    """A message on camera/calibration: since when it holds (ns), and its bytes."""

    timestamp: int
    payload: bytes


@dataclass
class Contents:
    """Everything but payloads: what was found, and what is wrong.

    Attributes:
        profile: of the file.
        schemas, channels: by their numbers in the file.
        metadata, attachments: every record, in file order.
        calibrations: what was said on camera/calibration.
        incomplete: sequences (32 bits) of frames that lack a message; `fieldless` of them lack their fields.
        leftover: places of messages on the frames' topics that belong to no whole frame.
        lost: messages known to be lost, by topic.
    """

    profile: str = ""
    schemas: dict[int, SchemaRecord] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[AttachmentEntry] = field(default_factory=list)
    topics: dict[str, TopicEntry] = field(default_factory=dict)
    frames: list[FrameEntry] = field(default_factory=list)
    calibrations: list[SaidCalibration] = field(default_factory=list)
    incomplete: list[int] = field(default_factory=list)
    fieldless: int = 0
    invalid: list[InvalidFrame] = field(default_factory=list)
    leftover: set[Place] = field(default_factory=set)
    faults: list[Fault] = field(default_factory=list)
    lost: Counter[str] = field(default_factory=Counter)

    def schema(self, channel: Channel) -> Schema:
        """How messages of a channel are read; empty where that is lost or never was."""
        found = self.schemas.get(channel.schema_id)
        return _NO_SCHEMA if found is None else Schema(found.name, cast(Any, found.encoding), found.data)


def read_contents(path: Path) -> Contents:
    """Read a file through once, checksums compared.

    Raises:
        RecordingError: not a file that can be read as MCAP.
    """
    check_magic(path)
    contents = Contents()
    gathering = _Gathering(contents)
    try:
        with path.open("rb") as file:
            for found in read_messages(file, contents):
                gathering.add(found)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read to its end ({error}); copy it again") from error
    gathering.finish()
    return contents


def read_messages(file: BinaryIO, contents: Contents) -> Iterator[FoundMessage]:
    """Every message in file order; all else is noted in `contents`."""
    losses = Losses()
    for item in walk(file):
        if isinstance(item, Fault):
            contents.faults.append(item)
            losses.fault(item)
            continue
        match item.record:
            case OpenedChunk() as chunk:
                losses.chunk(chunk)
                for definition in chunk.definitions:
                    _define(contents, definition)
                for stored in chunk.messages:
                    place = Place(item.offset, stored.start, stored.end)
                    payload = chunk.content[stored.start : stored.end]
                    yield from _found(contents, losses, stored, place, payload)
            case StoredMessage() as stored:
                file.seek(stored.start)
                payload = file.read(stored.end - stored.start)
                yield from _found(contents, losses, stored, Place(None, stored.start, stored.end), payload)
            case MessageIndex() as index:
                fault = losses.index(index, item)
                contents.faults += [] if fault is None else [fault]
            case Statistics() as statistics:
                losses.statistics = statistics
            case _:
                _note(contents, item)
    contents.lost = losses.by_topic(contents.channels)


def _found(
    contents: Contents, losses: Losses, stored: StoredMessage, place: Place, payload: bytes
) -> Iterator[FoundMessage]:
    channel = contents.channels.get(stored.channel)
    losses.message(stored.channel, is_known=channel is not None)
    if channel is not None:
        yield FoundMessage(channel, stored, place, payload)


def _note(contents: Contents, item: Located) -> None:
    match item.record:
        case Header() as header:
            contents.profile = header.profile
        case (SchemaRecord() | Channel()) as definition:
            _define(contents, definition)
        case Metadata() as metadata:
            contents.metadata.append(metadata)
        case AttachmentEntry() as attached:
            contents.attachments.append(attached)


def _define(contents: Contents, record: SchemaRecord | Channel) -> None:
    """Remember a definition; the first holds, the index's where there is one: it has a checksum."""
    if isinstance(record, Channel):
        contents.channels.setdefault(record.id, record)
    else:
        contents.schemas.setdefault(record.id, record)


class _Gathering:
    """Counts topics and puts frames together."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents
        self._assembler = FrameAssembler()
        self._refused: set[Key] = set()

    def add(self, found: FoundMessage) -> None:
        topic, stored = found.topic, found.stored
        self._count(topic, found)
        if topic == CAMERA_CALIBRATION and found.channel.message_encoding == "protobuf":
            said = SaidCalibration(stored.publish_time, found.payload)
            self._contents.calibrations.append(said)
        elif found.channel.message_encoding == MESSAGE_ENCODINGS.get(topic):
            self._add_part(topic, found)

    def finish(self) -> None:
        """No more messages will come."""
        for key, parts in self._assembler.incomplete():
            self._contents.leftover.update(part.place for part in parts)
            if key not in self._refused:
                self._contents.incomplete.append(key[1])
                self._contents.fieldless += not any(isinstance(part.said, FrameFields) for part in parts)

    def _add_part(self, topic: str, found: FoundMessage) -> None:
        key = found.stored.publish_time, found.stored.sequence
        places = [found.place]
        try:
            whole = self._assembler.add(
                topic, key, part_of(topic, found.payload, found.place, found.stored.log_time)
            )
            if whole is not None:
                places = [part.place for part in whole if part is not None]
                self._contents.frames.append(frame_entry(*whole))
        except RecordingError as error:
            self._contents.leftover.update(places)
            if key not in self._refused:
                self._contents.invalid.append(InvalidFrame(found.stored.sequence, str(error)))
            self._refused.add(key)

    def _count(self, topic: str, found: FoundMessage) -> None:
        at, known = found.stored.log_time, self._contents.schemas.get(found.channel.schema_id)
        schema = "" if known is None else known.name
        entry = self._contents.topics.get(topic)
        if entry is None:
            entry = self._contents.topics[topic] = TopicEntry([], 0, at, at)
        entry.count += 1
        entry.first, entry.last = min(entry.first, at), max(entry.last, at)
        if schema not in entry.schemas:
            entry.schemas.append(schema)


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
