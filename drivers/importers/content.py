"""Content of a file, of which no more is read than a frame can need."""

from pathlib import Path

from drivers.errors import RecordingError


def read_bounded(path: Path, limit: int, kind: str) -> bytes:
    """All bytes of a file.

    Args:
        limit: bytes that no file of this kind exceeds.
        kind: for messages, as `text frame`.

    Raises:
        RecordingError: cannot be read, is no ordinary file, or is longer than `limit`.
    """
    try:
        if path.exists() and not path.is_file():
            raise RecordingError(f"{path}: is not an ordinary file; name a {kind}")
        with path.open("rb") as file:
            content = file.read(limit + 1)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); name a {kind}") from error
    if len(content) > limit:
        raise RecordingError(f"{path}: has more than {limit:,} bytes, the most that a {kind} can have")
    return content
