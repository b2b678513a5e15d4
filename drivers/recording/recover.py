"""A whole recording of what a torn or damaged one still holds."""

from pathlib import Path

from drivers.errors import RecordingError
from drivers.recording.assembly import FRAME_TOPICS
from drivers.recording.attachments import VERSIONS
from drivers.recording.output import WORKING_SUFFIX
from drivers.recording.reader import Recording
from drivers.recording.writer import SEQUENCE_MASK, RecordingWriter


def recovered_path(path: Path) -> Path:
    """Where a recovered file goes by default: `x.recovered.mcap` for `x.mcap` and for `x.mcap.active`."""
    whole = path.with_name(path.name.removesuffix(WORKING_SUFFIX))
    return whole.with_name(f"{whole.stem}.recovered{whole.suffix}")


def recover(recording: Recording, output: Path) -> int:
    """Write all that can be read into a new file, in order; images of incomplete frames are left out.

    Returns:
        How many messages were written.

    Raises:
        RecordingError: there is no message to save, or output and input are one file.
        StorageError: the file cannot be written.
    """
    taken = (output, output.with_name(output.name + WORKING_SUFFIX))
    if any(path.exists() and path.samefile(recording.path) for path in taken):
        raise RecordingError(f"{recording.path}: cannot be recovered in place; name another output")
    if not recording.topics:
        raise RecordingError(f"{recording.path}: holds no whole message; nothing can be recovered")
    with RecordingWriter(output, recording.metadata, recording.attachment(VERSIONS)) as writer:
        for name, found in recording.attachments.items():
            if name != VERSIONS:
                writer.attach(name, found.data, found.media_type, found.log_time)
        saved = 0
        whole = {(entry.timestamp, entry.sequence & SEQUENCE_MASK) for entry in recording.entries}
        for message, log_time in recording.messages():
            if message.topic not in FRAME_TOPICS or (message.publish_time, message.sequence) in whole:
                writer.write(message, log_time)
                saved += 1
    return saved
