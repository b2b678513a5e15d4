"""A whole recording of what a torn or damaged one still holds, every record as it is."""

from pathlib import Path

from drivers.errors import RecordingError
from drivers.recording.assembly import Place
from drivers.recording.container import Fault, Located, walk
from drivers.recording.contents import Contents
from drivers.recording.copying import Copy
from drivers.recording.output import WORKING_SUFFIX
from drivers.recording.reader import Recording
from drivers.recording.records import OpenedChunk, StoredMessage


def recovered_path(path: Path) -> Path:
    """Where a recovered file goes by default: `x.recovered.mcap` for `x.mcap` and for `x.mcap.active`."""
    whole = path.with_name(path.name.removesuffix(WORKING_SUFFIX))
    return whole.with_name(f"{whole.stem}.recovered{whole.suffix}")


def recover(recording: Recording, output: Path) -> int:
    """Write all that can be read into a new file, in order, but messages of frames that are not whole.

    Profile, schemas, channels, metadata, attachments and foreign messages stay as they are, and so do the
    chunks and their compression.

    Returns:
        How many messages were written.

    Raises:
        RecordingError: there is nothing to save, or output and input are one file.
        StorageError: the file cannot be written.
    """
    taken = (output, output.with_name(output.name + WORKING_SUFFIX))
    if any(path.exists() and path.samefile(recording.path) for path in taken):
        raise RecordingError(f"{recording.path}: cannot be recovered in place; name another output")
    found = recording.contents
    if not (found.topics or found.attachments or found.metadata):
        raise RecordingError(f"{recording.path}: holds no whole message; nothing can be recovered")
    with recording.path.open("rb") as source, Copy(source, output, found.profile) as copy:
        copy.define(found.schemas.values(), found.channels.values())
        for item in walk(source):
            if not isinstance(item, Fault) and item.length:
                _copy(copy, item, found)
    return copy.messages


def _copy(copy: Copy, item: Located, found: Contents) -> None:
    match item.record:
        case OpenedChunk() as chunk:
            kept = [m for m in chunk.messages if _is_kept(found, m, Place(item.offset, m.start, m.end))]
            copy.chunk(item, chunk, kept)
        case StoredMessage() as message:
            if _is_kept(found, message, Place(None, message.start, message.end)):
                copy.message(item, message)
        case _:
            copy.other(item)


def _is_kept(found: Contents, message: StoredMessage, place: Place) -> bool:
    return message.channel in found.channels and place not in found.leftover
