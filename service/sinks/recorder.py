"""Recording what is published, byte for byte."""

import json
import logging
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event as Flag
from typing import ClassVar

from drivers.errors import StorageError
from drivers.messages import Message
from drivers.recording import RecordingHead, attachments
from service.config.sections import RecordingSection
from service.errors import EncodingError, OutputError
from service.messages.encoding import event_messages
from service.messages.events import (
    BurstCaptured,
    Commanded,
    Event,
    FrameCaptured,
    HeadChanged,
    MapFused,
)
from service.messages.status import RecorderState
from service.messages.topics import TOPICS
from service.messages.viewing import Extras
from service.sinks.destination import Destination, is_over
from service.sinks.preroll import Preroll
from service.sinks.recording_directory import RecordingDirectory
from service.sinks.recording_file import RecordingFile, Unit
from service.sinks.recovery import Recovery
from service.sinks.sink import Room, Sink

RECORDER = "recorder"
"""How the one that writes into the recording folder is called."""

_RETRY = 1.0
"""Seconds after which a place that could not be written is tried again, and between looks at the file."""

_MOST_WAITING = 64 << 20
"""Bytes that wait for a file."""

_GONE = "{} is gone: its folder was deleted or unmounted while it was written"

_log = logging.getLogger(__name__)


class Recorder(Sink):
    """Writes the recorded topics of every event; a file begins once it is known what the devices are.

    What belongs together (the messages of one event) is written, or lost, as one. A disk that is full,
    read-only, taken away or not there stops the recording alone: what was written is kept, what comes
    meanwhile waits for as long as the pre-roll is and is counted as lost thereafter, and every second it is
    tried again.

    Args:
        destination: a `RecordingDirectory` or a `FileSeries`.
        maps: whether fused maps are written, beside frames and all else.
        extras: what is written of each map beside it.
        replays: whether anything is written while a recording is played.
        wanted: set = record; may be changed while it works. None = always.
        preroll: seconds before its start that a recording begins with.
        now: nanoseconds since the epoch, when a message was received.
    """

    room = Room(4096, 128 << 20)
    """Twenty seconds of a camera at 50 frames/s: more than a disk that is busy with something else takes."""
    droppable = (MapFused, FrameCaptured)
    unit: ClassVar[str] = "messages"

    def __init__(
        self,
        destination: Destination,
        *,
        maps: bool = True,
        extras: Extras = Extras(),  # noqa: B008 — frozen
        replays: bool = False,
        wanted: Flag | None = None,
        preroll: float = 0.0,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__()
        self._destination, self._now = destination, now
        self.maps, self.extras, self.replays = maps, extras, replays
        self._wanted = wanted
        self._has_preroll = preroll > 0
        self._head: RecordingHead | None = None
        self._file: RecordingFile | None = None
        self._files: list[Path] = []
        self._waiting = Preroll(preroll, _MOST_WAITING)
        self._recovery: Recovery | None = None
        self._kept = self._lost = 0
        self._fault: str | None = None
        self._reasons: dict[str, None] = {}
        self._again = self._looked = 0.0

    def take(self, event: Event) -> None:
        if isinstance(event, HeadChanged):
            self._change(event.head)
        if self._head is None or self.abandoned.is_set():
            return
        if self.is_wanted:
            self._queue(event)
            self._recover_once()
            self._write_waiting()
            self._note(event)
            self._lost += self._waiting.forget(time.monotonic())
            return
        self._finish()
        self._fault = None
        if self._has_preroll and self._may_be_recorded:
            self._queue(event)
            self._waiting.forget(time.monotonic())

    def close(self) -> None:
        """Complete the file; after a failure what was written before is kept."""
        if self._recovery is not None:
            self._recovery.stop()
        if self.is_wanted and self._waiting.first is not None:
            self._again = 0.0
            self._write_waiting()
            self._lost += self._waiting.clear()
        self._finish()

    def discard(self) -> None:
        """Leave nothing of the file behind; those that are complete stay."""
        if self._recovery is not None:
            self._recovery.stop()
        file, self._file = self._file, None
        if file is not None:
            file.discard()

    @property
    def is_wanted(self) -> bool:
        """Whether it shall record."""
        return self._may_be_recorded and (self._wanted is None or self._wanted.is_set())

    @property
    def _may_be_recorded(self) -> bool:
        """Whether what comes is no replay, or replays are asked for."""
        played = self._head is not None and self._head.metadata.get("source") == "replay"
        return self.replays or not played

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(str(path) for path in self._files if _is_there(path))

    @property
    def fault(self) -> str | None:
        return self._fault

    @property
    def lost(self) -> int:
        return self._lost

    @property
    def losses(self) -> tuple[str, ...]:
        return tuple(self._reasons)

    def worth(self, event: Event) -> int:
        if not self.is_wanted:
            return 0
        with suppress(EncodingError):
            return len(self._recorded(event))
        return 1

    @property
    def written(self) -> Path | None:
        """The file at work, as it is called until it is complete."""
        return None if self._file is None else self._file.working_path

    @property
    def state(self) -> RecorderState:
        """What it is doing."""
        file = self._file
        path = file.path if file is not None else self._files[-1] if self._files else None
        return RecorderState(
            recording=file is not None,
            file=None if path is None else str(path),
            size=0 if file is None else file.size,
            messages=self._kept + (0 if file is None else file.taken),
            lost=self._lost,
            free=None if path is None else _free(path.parent),
            error=self._fault,
        )

    def _change(self, head: RecordingHead) -> None:
        """Have the next file begin with this; the one at work ends where frames come from elsewhere now."""
        if self._head is not None and _origin(self._head) != _origin(head):
            self._finish()
            gone = self._waiting.clear()
            self._lost += gone if self.is_wanted else 0
        self._head = head

    def _queue(self, event: Event) -> None:
        messages = self._recorded(event)
        if messages:
            begins = isinstance(event, BurstCaptured)
            self._waiting.append(Unit(messages, self._now(), time.monotonic(), begins))

    def _recorded(self, event: Event) -> tuple[Message, ...]:
        if isinstance(event, MapFused) and not self.maps:
            return ()
        extras = self.extras.of(event) if isinstance(event, MapFused) else ()
        return (*(m for m in event_messages(event) if TOPICS[m.topic].recorded), *extras)

    def _recover_once(self) -> None:
        """See to what an earlier run left, before there is a file of this one's own."""
        if self._recovery is None:
            try:
                left = self._destination.leftovers()
            except OSError:  # there is no folder yet
                left = []
            self._recovery = Recovery(left, self._destination.make_room)
            self._recovery.start()

    def _write_waiting(self) -> None:
        """Write all that waits; where that cannot be done it is tried again a second later."""
        if time.monotonic() < self._again:
            return
        try:
            self._look()
            while (unit := self._waiting.first) is not None:
                file = self._file_for(unit)
                self._waiting.pop()
                file.write(unit)
        except (StorageError, OutputError) as error:
            self._fail(error)
        else:
            if self._fault is not None and self._file is not None and self._file.written:
                _log.warning("recording goes on in %s, %d messages were lost", self._file.path, self._lost)
                self._fault = None

    def _note(self, event: Event) -> None:
        """Put down who had what done."""
        if isinstance(event, Commanded) and self._file is not None:
            try:
                self._file.note("command", _told(event))
            except StorageError as error:
                self._fail(error)

    def _look(self) -> None:
        """See now and then whether the file still is there; raises `StorageError`."""
        now = time.monotonic()
        if self._file is None or now - self._looked < _RETRY:
            return
        self._looked = now
        if not self._file.is_there:
            raise StorageError(_GONE.format(self._file.path))

    def _file_for(self, unit: Unit) -> RecordingFile:
        assert self._head is not None
        if self._file is not None and is_over(self._destination, self._file, unit.begins_burst):
            self._finish()
        if self._file is None:
            self._file = RecordingFile(self._destination.next_path(), self._head, self._now())
        return self._file

    def _fail(self, error: Exception) -> None:
        """End the file at a fault of its place; what it had not written yet waits again."""
        self._again = time.monotonic() + _RETRY
        if self._fault is None:
            _log.error("nothing is recorded: %s", error)
        self._fault = str(error)
        self._reasons[str(error)] = None
        self._waiting.put_back(self._end())

    def _finish(self) -> None:
        """Complete the file at work; what its end could not take is lost."""
        pending = self._end()
        self._lost += sum(len(unit.messages) for unit in pending)

    def _end(self) -> list[Unit]:
        """End the file at work: what it had not written; one that holds nothing, or is gone, goes."""
        file, self._file = self._file, None
        if file is None:
            return []
        if not file.is_there:
            self._lost += file.written
            self._reasons[_GONE.format(file.path)] = None
            file.discard()
            return file.pending
        try:
            file.close()
        except StorageError as error:
            self._reasons[str(error)] = None
        if file.written == 0:
            with suppress(OSError):
                file.path.unlink()
        self._kept += file.written
        self._files.append(file.path)
        return file.pending


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a disk that does not answer
        return False


def recorder_of(section: RecordingSection) -> Recorder:
    """The recorder of a service: files in the recording folder."""
    directory = RecordingDirectory(section, time.time_ns)
    return Recorder(
        directory,
        maps=section.maps,
        extras=Extras(section.points, section.depth_mm),
        replays=section.replays,
        preroll=section.preroll,
    )


def _origin(head: RecordingHead) -> tuple[object, ...]:
    """Whose frames they are, and by which calibration."""
    told = tuple(head.metadata.get(name) for name in ("source", "camera_model", "camera_serial"))
    return *told, *(content for name, content, _ in head.attachments if name == attachments.CALIBRATION)


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
