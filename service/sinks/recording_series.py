"""Files one after the other, each of which ends when it is full or its place fails."""

import logging
import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from drivers.errors import StorageError
from drivers.recording import RecordingHead
from service.errors import OutputError
from service.messages.status import RecorderState
from service.sinks.destination import Destination, is_over
from service.sinks.preroll import Preroll
from service.sinks.recording_file import RecordingFile, Unit

_RETRY = 1.0
"""Seconds after which a place that could not be written is tried again, and between looks at the file."""

_GONE = "{} is gone: its folder was deleted or unmounted while it was written"

_log = logging.getLogger(__name__)


class RecordingSeries:
    """Writes what waits; what cannot be written waits on, and every second it is tried again.

    Args:
        destination: a `RecordingDirectory` or a `FileSeries`.
        waiting: what is in no file yet.
        now: nanoseconds since the epoch.

    Attributes:
        head: what the next file begins with.
        lost: messages that are in no file and never will be.
        fault: why nothing can be written at present; None = it can.
    """

    def __init__(self, destination: Destination, waiting: Preroll, now: Callable[[], int]) -> None:
        self._destination, self._waiting, self._now = destination, waiting, now
        self.head: RecordingHead | None = None
        self._file: RecordingFile | None = None
        self._files: list[Path] = []
        self._kept = self.lost = 0
        self.fault: str | None = None
        self._reasons: dict[str, None] = {}
        self._again = self._looked = 0.0

    def write(self, *, at_once: bool = False) -> None:
        """Write all that waits; a place that failed is left alone for a second, unless it is now or never."""
        if time.monotonic() < self._again and not at_once:
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
            if self.fault is not None and self._file is not None and self._file.written:
                _log.warning("recording goes on in %s, %d messages were lost", self._file.path, self.lost)
                self.fault = None

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record to the file at work."""
        if self._file is not None:
            try:
                self._file.note(name, content)
            except StorageError as error:
                self._fail(error)

    def finish(self) -> None:
        """Complete the file at work; what its end could not take is lost."""
        pending = self._end()  # which may count more as lost
        self.lost += sum(len(unit.messages) for unit in pending)

    def discard(self) -> None:
        """Leave nothing of the file at work behind."""
        file, self._file = self._file, None
        if file is not None:
            file.discard()

    @property
    def written(self) -> Path | None:
        """The file at work, as it is called until it is complete."""
        return None if self._file is None else self._file.working_path

    @property
    def files(self) -> tuple[str, ...]:
        """Those that are complete, and there."""
        return tuple(str(path) for path in self._files if _is_there(path))

    @property
    def losses(self) -> tuple[str, ...]:
        """Why something was lost, in words."""
        return tuple(self._reasons)

    @property
    def state(self) -> RecorderState:
        """How it is doing."""
        file = self._file
        path = file.path if file is not None else self._files[-1] if self._files else None
        return RecorderState(
            recording=file is not None,
            file=None if path is None else str(path),
            size=0 if file is None else file.size,
            messages=self._kept + (0 if file is None else file.taken),
            lost=self.lost,
            free=None if path is None else _free(path.parent),
            error=self.fault,
        )

    def _look(self) -> None:
        """See now and then whether the file still is there; raises `StorageError`."""
        now = time.monotonic()
        if self._file is None or now - self._looked < _RETRY:
            return
        self._looked = now
        if not self._file.is_there:
            raise StorageError(_GONE.format(self._file.path))

    def _file_for(self, unit: Unit) -> RecordingFile:
        assert self.head is not None
        if self._file is not None and is_over(self._destination, self._file, unit.begins_burst):
            self.finish()
        if self._file is None:
            path, compression = self._destination.next_path(), self._destination.compression
            self._file = RecordingFile(path, self.head, self._now(), compression)
        return self._file

    def _fail(self, error: Exception) -> None:
        """End the file at a fault of its place; what it had not written yet waits again."""
        self._again = time.monotonic() + _RETRY
        if self.fault is None:
            _log.error("nothing is recorded: %s", error)
        self.fault = str(error)
        self._reasons[str(error)] = None
        self._waiting.put_back(self._end())

    def _end(self) -> list[Unit]:
        """End the file at work: what it had not written; one that holds nothing, or is gone, goes."""
        file, self._file = self._file, None
        if file is None:
            return []
        if not file.is_there:
            self.lost += file.written
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


def _free(directory: Path) -> int | None:
    try:
        return shutil.disk_usage(directory).free
    except OSError:  # taken away meanwhile
        return None
