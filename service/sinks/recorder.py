"""Recording what is published, byte for byte."""

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from drivers.recording import RecordingHead
from service.messages.encoding import event_messages
from service.messages.events import (
    BurstCaptured,
    Commanded,
    DevicesOpened,
    Event,
    FrameCaptured,
    HeadChanged,
    MapFused,
)
from service.messages.status import RecorderState
from service.messages.topics import TOPICS
from service.sinks.recording_file import RecordingFile, Unit
from service.sinks.sink import Room, Sink

_OVERDUE = 1.1
"""A file is ended between two bursts, and in the middle of one only when it is a tenth over its limit."""


class Destination(Protocol):
    """Where files go and when the next one is due."""

    def prepare(self) -> None: ...
    def next_path(self) -> Path: ...
    def is_full(self, size: float, age: float) -> bool: ...


class Recorder(Sink):
    """Writes the recorded topics of every event; a file begins once it is known what the devices are.

    What belongs together (the messages of one event) is written, or lost, as one. A full or vanished disk
    ends the file; what was written is kept, and the next recorder begins another.

    Args:
        destination: a `RecordingDirectory` or a `FileSeries`.
        maps: whether fused maps are written, beside frames and all else.
        now: nanoseconds since the epoch, when a message was received.
    """

    room = Room(4096, 128 << 20)
    """Twenty seconds of a camera at 50 frames/s: more than a disk that is busy with something else takes."""
    droppable = (MapFused, FrameCaptured)

    def __init__(
        self, destination: Destination, *, maps: bool = True, now: Callable[[], int] = time.time_ns
    ) -> None:
        super().__init__()
        self._destination, self._maps, self._now = destination, maps, now
        self._head: RecordingHead | None = None
        self._file: RecordingFile | None = None
        self._files: list[Path] = []
        self._messages = 0

    def open(self) -> None:
        self._destination.prepare()

    def take(self, event: Event) -> None:
        if isinstance(event, (DevicesOpened, HeadChanged)):
            self._head = event.head
        if isinstance(event, Commanded) and self._file is not None:
            self._file.note("command", _told(event))
        if self._head is None or (isinstance(event, MapFused) and not self._maps):
            return
        messages = tuple(m for m in event_messages(event) if TOPICS[m.topic].recorded)
        if not messages or self.abandoned.is_set():
            return
        if self._file is not None and self._is_over(
            self._file, begins_burst=isinstance(event, BurstCaptured)
        ):
            self.close()
        if self._file is None:
            self._file = RecordingFile(self._destination.next_path(), self._head, self._now())
        self._file.write(Unit(messages, self._now()))
        self._messages += len(messages)

    def close(self) -> None:
        """Complete the file; after a failure what was written before is kept."""
        file, self._file = self._file, None
        if file is not None:
            self._files.append(file.path)
            file.close()

    def discard(self) -> None:
        """Leave nothing of the file behind; those that are complete stay."""
        file, self._file = self._file, None
        if file is not None:
            file.discard()

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(str(path) for path in self._files if path.exists())

    @property
    def state(self) -> RecorderState:
        """What it is doing."""
        file = self._file
        path = file.path if file is not None else self._files[-1] if self._files else None
        return RecorderState(
            recording=file is not None,
            file=None if path is None else str(path),
            size=0 if file is None else file.size,
            messages=self._messages,
            free=None if path is None else _free(path.parent),
        )

    def _is_over(self, file: RecordingFile, *, begins_burst: bool) -> bool:
        size, age = file.size, file.age
        if begins_burst and self._destination.is_full(size, age):
            return True
        return self._destination.is_full(size / _OVERDUE, age / _OVERDUE)


def _told(event: Commanded) -> dict[str, str]:
    return {
        "who": event.who,
        "when": str(event.timestamp),
        "command": event.command,
        "arguments": json.dumps(event.arguments),
    }


def _free(directory: Path) -> int | None:
    try:
        return shutil.disk_usage(directory).free
    except OSError:  # taken away meanwhile
        return None
