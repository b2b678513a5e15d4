"""One file of a running recorder, flushed at a steady beat."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import StorageError
from drivers.messages import CAMERA_FRAME, Message
from drivers.recording import Compression, RecordingHead, RecordingWriter

_FLUSH_INTERVAL = 1.0
"""Seconds of data that a killed process may lose; a shorter beat makes smaller chunks that compress less."""
_MOST_FRAMES = 3
"""Frames that a killed process may lose."""
_SYNC_INTERVAL = 10.0
"""Seconds of data that a power cut may take; putting them on the disk can take a good part of a second."""


@dataclass(frozen=True, slots=True)
class Unit:
    """Messages that stand or fall together.

    Attributes:
        messages: as they were published.
        received: when they came, ns since the epoch.
        taken: the same, seconds on a clock that nobody sets.
        begins_burst: whether a file had better end before it.
        is_map: whether it is a fused map.
    """

    messages: tuple[Message, ...]
    received: int
    taken: float = 0.0
    begins_burst: bool = False
    is_map: bool = False

    @property
    def size(self) -> int:
        return sum(len(message.payload) for message in self.messages)

    @property
    def is_frame(self) -> bool:
        return any(message.topic == CAMERA_FRAME for message in self.messages)


class RecordingFile:
    """A recording being written.

    Attributes:
        written: messages that the system has taken over: they survive this process.
        pending: units that would be lost with it.

    Raises:
        StorageError: it cannot be made or written. Writing is over then.
    """

    def __init__(self, path: Path, head: RecordingHead, now: int, compression: Compression) -> None:
        self.path = path
        self.written = 0
        self.pending: list[Unit] = []
        self._writer = RecordingWriter(path, head.metadata, compression)
        try:
            head.attach_to(self._writer, now)
        except BaseException:
            self._writer.discard()
            raise
        self._began = self._flushed = self._synced = time.monotonic()

    @property
    def working_path(self) -> Path:
        """What it is called until it is complete."""
        return self._writer.working_path

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._writer.size

    @property
    def taken(self) -> int:
        """Messages written or pending."""
        return self.written + sum(len(unit.messages) for unit in self.pending)

    @property
    def age(self) -> float:
        """Seconds since it was begun."""
        return time.monotonic() - self._began

    @property
    def is_there(self) -> bool:
        """Whether it still is where it was made."""
        return self._writer.is_there

    def write(self, unit: Unit) -> None:
        self.pending.append(unit)
        for message in unit.messages:
            size = self._writer.size
            self._writer.write(message, unit.received)
            if self._writer.size > size:  # a chunk, up to this message
                self._settle(message is unit.messages[-1])
        elapsed = time.monotonic()
        frames = sum(one.is_frame for one in self.pending)
        if elapsed - self._flushed >= _FLUSH_INTERVAL or frames >= _MOST_FRAMES:
            due = elapsed - self._synced >= _SYNC_INTERVAL
            self._writer.flush(sync=due)
            self._settle(True)
            self._flushed = elapsed
            self._synced = elapsed if due else self._synced

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._writer.note(name, content)

    def close(self) -> None:
        """Complete it; after a failure this keeps what was written before.

        Raises:
            StorageError: the end could not be written, or it still has its working name.
        """
        failure: StorageError | None = None
        try:
            if self.pending:
                self._writer.flush()
                self._settle(True)
        except StorageError as error:
            failure = error
        self._writer.close()
        if failure is not None:
            raise failure

    def discard(self) -> None:
        """Leave nothing behind."""
        self._writer.discard()

    def _settle(self, whole: bool) -> None:
        """All units are on the disk; of the last one perhaps a part."""
        rest = [] if whole else self.pending[-1:]
        self.written += sum(len(unit.messages) for unit in self.pending[: len(self.pending) - len(rest)])
        self.pending = rest
