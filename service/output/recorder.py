"""Recording what is published, byte for byte, without ever holding up who publishes it."""

import logging
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import RLock, Thread
from typing import Protocol

from pydantic import BaseModel, ConfigDict, Field

from drivers.errors import StorageError
from drivers.messages import CAMERA_CALIBRATION, Message
from drivers.recording import RecordingHead
from service.errors import ServiceError
from service.output.recording_file import RecordingFile, Unit
from service.topics import TOPICS
from service.wire.outbox import Outbox

_QUEUE_UNITS = 4096
_QUEUE_BYTES = 128 << 20
"""Twenty seconds of a camera at 50 frames/s: more than a disk that is busy with something else takes."""

_OVERDUE = 1.1
"""A file is ended between two bursts, and in the middle of one only when it is a tenth over its limit."""

_log = logging.getLogger(__name__)


class Destination(Protocol):
    """Where files go and when the next one is due."""

    def next_path(self) -> Path: ...
    def is_full(self, size: float, age: float) -> bool: ...
    def keep(self, path: Path) -> None: ...


class RecorderState(BaseModel):
    """What the recorder is doing."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    recording: bool = Field(False, description="Whether it records.")
    file: str | None = Field(None, description="The file being written, or the last one.")
    kept: bool = Field(False, description="Whether that file is marked to keep.")
    size: int = Field(0, ge=0, description="Bytes in it.")
    messages: int = Field(0, ge=0, description="Messages written since the service started.")
    dropped: int = Field(0, ge=0, description="Messages lost because the disk was too slow or full.")
    free: int | None = Field(None, description="Bytes free on the disk; none while nothing was recorded.")
    error: str | None = Field(None, description="Why it stopped by itself; none = it did not.")


class Recorder:
    """Takes messages at any time; one thread of its own writes them while it is started.

    The queue is bounded by count and by bytes and loses its oldest unit when it is full; every loss is
    counted. When the disk fails, recording ends with what was written kept, `state.error` says why, and the
    rest of the service goes on.

    Args:
        destination: a `Shelf` or a `SingleFile`.
        head: asked for at the beginning of every file.
        lossless: `record` waits for the disk instead of dropping.
        now: nanoseconds since the epoch, when a message was received.
    """

    def __init__(
        self,
        destination: Destination,
        head: Callable[[], RecordingHead] = RecordingHead,
        *,
        lossless: bool = False,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._destination, self._head, self._lossless, self._now = destination, head, lossless, now
        self._control = RLock()
        self._outbox: Outbox[Unit] | None = None
        self._thread: Thread | None = None
        self._file: RecordingFile | None = None
        self._kept = self._abandoned = False
        self._messages = self._dropped = 0
        self._error: str | None = None

    @property
    def is_recording(self) -> bool:
        return self._outbox is not None and self._error is None

    def start(self) -> Path:
        """Begin a file; returns its path. Starting a started recorder does nothing.

        Raises:
            OutputError, StorageError: no file can be made there.
        """
        with self._control:
            if self._file is not None and self.is_recording:
                return self._file.path
            self.stop()
            self._error, self._abandoned = None, False
            file = self._open()
            self._outbox = Outbox(_QUEUE_UNITS, _QUEUE_BYTES, lossless=self._lossless, dropped=self._lose)
            self._thread = Thread(target=self._run, args=(self._outbox, file), name="recorder", daemon=True)
            self._thread.start()
            return file.path

    def record(self, messages: Sequence[Message]) -> None:
        """Hand over messages that belong together: they are written, or lost, as one.

        Those that the table does not record are left out; while the recorder is stopped, all are.
        """
        outbox = self._outbox
        unit = Unit(tuple(m for m in messages if TOPICS[m.topic].recorded), self._now())
        if unit.messages and outbox is not None and self._error is None:
            outbox.put(unit, unit.size)

    def keep(self) -> Path:
        """Mark the file being written, or the last one, never to be deleted.

        Raises:
            ServiceError: nothing was recorded yet.
        """
        with self._control:
            if self._file is None:
                raise ServiceError("nothing was recorded yet, so nothing can be kept; start recording first")
            self._destination.keep(self._file.path)
            self._kept = True
            return self._file.path

    def stop(self) -> RecorderState:
        """Write what is waiting and complete the file; the state says whether all went well."""
        with self._control:
            if self._outbox is not None and self._thread is not None:
                self._outbox.close()
                self._thread.join()
                self._outbox = self._thread = None
        return self.state

    def discard(self) -> None:
        """Stop and leave nothing of the file behind; one that is complete stays."""
        with self._control:
            if self._outbox is not None:
                self._abandoned = True
                self._outbox.clear()
                self.stop()

    @property
    def state(self) -> RecorderState:
        file = self._file
        return RecorderState(
            recording=self.is_recording,
            file=None if file is None else str(file.path),
            kept=self._kept,
            size=0 if file is None else file.size,
            messages=self._messages,
            dropped=self._dropped,
            free=None if file is None else _free(file.path.parent),
            error=self._error,
        )

    def _run(self, outbox: Outbox[Unit], file: RecordingFile) -> None:
        try:
            while (unit := outbox.get()) is not None:
                if self._error is None:
                    file = self._write(file, unit)
                else:
                    self._lose(unit)
        finally:
            self._end(file)

    def _write(self, file: RecordingFile, unit: Unit) -> RecordingFile:
        """Write a unit; returns the file that the next one goes to."""
        try:
            if self._is_over(file, unit):
                self._end(file)
                file = self._open()
            file.write(unit)
            self._messages += len(unit.messages)
        except Exception as error:  # the thread must live to count what is lost from now on
            self._end(file)
            self._fail(error)
            self._lose(unit)
        return file

    def _is_over(self, file: RecordingFile, unit: Unit) -> bool:
        size, age = file.size, file.age
        begins_burst = any(message.topic == CAMERA_CALIBRATION for message in unit.messages)
        if begins_burst and self._destination.is_full(size, age):
            return True
        return self._destination.is_full(size / _OVERDUE, age / _OVERDUE)

    def _open(self) -> RecordingFile:
        file = RecordingFile(self._destination.next_path(), self._head(), self._now())
        self._file, self._kept = file, False
        return file

    def _end(self, file: RecordingFile) -> None:
        try:
            if self._abandoned:
                file.discard()
            else:
                file.close()
        except (StorageError, OSError) as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._error = str(error)
        _log.error("recording stopped: %s", error)

    def _lose(self, unit: Unit) -> None:
        self._dropped += len(unit.messages)


def _free(directory: Path) -> int | None:
    try:
        return shutil.disk_usage(directory).free
    except OSError:  # taken away meanwhile
        return None
