"""One file of a running recorder, flushed at a steady beat."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.messages import Message
from drivers.recording import RecordingHead, RecordingWriter

_FLUSH_INTERVAL = 1.0
"""Seconds of data that a killed process may lose; a shorter beat makes smaller chunks that compress less."""
_SYNC_INTERVAL = 10.0
"""Seconds of data that a power cut may take; putting them on the disk can take a good part of a second."""


@dataclass(frozen=True, slots=True)
class Unit:
    """Messages that stand or fall together, and when they came, ns since the epoch."""

    messages: tuple[Message, ...]
    received: int

    @property
    def size(self) -> int:
        return sum(len(message.payload) for message in self.messages)


class RecordingFile:
    """A recording being written.

    Raises:
        StorageError: it cannot be made or written.
    """

    def __init__(self, path: Path, head: RecordingHead, now: int) -> None:
        self.path = path
        self._writer = RecordingWriter(path, head.metadata)
        try:
            head.attach_to(self._writer, now)
        except BaseException:
            self._writer.discard()
            raise
        self._began = self._flushed = self._synced = time.monotonic()

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._writer.size

    @property
    def age(self) -> float:
        """Seconds since it was begun."""
        return time.monotonic() - self._began

    def write(self, unit: Unit) -> None:
        for message in unit.messages:
            self._writer.write(message, unit.received)
        elapsed = time.monotonic()
        if elapsed - self._flushed >= _FLUSH_INTERVAL:
            due = elapsed - self._synced >= _SYNC_INTERVAL
            self._writer.flush(sync=due)
            self._flushed = elapsed
            self._synced = elapsed if due else self._synced

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._writer.note(name, content)

    def close(self) -> None:
        """Complete it; after a failure this keeps what was written before."""
        self._writer.close()

    def discard(self) -> None:
        """Leave nothing behind."""
        self._writer.discard()
