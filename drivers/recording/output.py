"""A file that is written under a working name and holds whole records whatever happens."""

import contextlib
import errno
import logging
import os
from io import FileIO
from pathlib import Path

from drivers.errors import StorageError
from drivers.recording.locks import claim, is_used

logger = logging.getLogger(__name__)

WORKING_SUFFIX = ".active"


def open_unbuffered(path: Path) -> FileIO:
    """A new, empty file; each write reaches the system at once and survives the process."""
    return FileIO(path, "x+")


class Output:
    """The byte stream under a recording: whole writes or none.

    The file is called `path + ".active"` until it is complete. One left behind by a process that died is
    kept as `name.torn.mcap`; one that another process still writes is refused.

    Raises:
        StorageError: the file cannot be made, or written: disk full, no permission, in use.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.working_path = path.with_name(path.name + WORKING_SUFFIX)
        self._size = 0
        self._failure: StorageError | None = None
        try:
            _set_aside(self.working_path, path)
            self._file = open_unbuffered(self.working_path)
        except OSError as error:
            raise _storage_error(path, error) from error
        try:
            claim(self._file.fileno(), self.working_path)
        except OSError as error:
            self.discard()
            raise _storage_error(path, error) from error

    @property
    def failure(self) -> StorageError | None:
        """What made writing fail; None while all is well."""
        return self._failure

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """Nothing is held back here."""

    def write(self, data: bytes) -> int:
        """Append all of `data`, or raise `StorageError` and leave the file as it was before."""
        if self._failure is not None:
            raise self._failure
        rest = memoryview(data)
        try:
            while rest:  # a raw write may take less than it was given
                rest = rest[self._file.write(rest) or 0 :]
        except OSError as error:
            self._failure = _storage_error(self.path, error)
            self._truncate()
            raise self._failure from error
        self._size += len(data)
        return len(data)

    def append_last(self, data: bytes) -> None:
        """Write after a failure, as far as it goes: the room freed by the failed write mostly suffices."""
        with contextlib.suppress(OSError):
            if self._file.write(data) != len(data):
                self._truncate()

    def sync(self) -> None:
        """Have the system put on the disk what it holds; for power cuts."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _storage_error(self.path, error) from error

    @property
    def is_there(self) -> bool:
        """Whether the file still is where it was made: not deleted, and nothing mounted over its folder."""
        try:
            return os.path.samestat(self.working_path.stat(), os.fstat(self._file.fileno()))
        except OSError:
            return False

    def finish(self) -> None:
        """Give the file its name; it keeps the working name where that cannot be done."""
        try:
            with self._file:
                self.sync()
            self.working_path.replace(self.path)
        except OSError as error:
            raise _storage_error(self.path, error) from error

    def discard(self) -> None:
        """Remove the file, where that can be done."""
        self._file.close()
        with contextlib.suppress(OSError):
            self.working_path.unlink()

    def _truncate(self) -> None:
        with contextlib.suppress(OSError):
            self._file.truncate(self._size)
            self._file.seek(self._size)


def _set_aside(working_path: Path, path: Path) -> None:
    if not working_path.exists():
        return
    if is_used(working_path):
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    kept = torn_path(path)
    working_path.rename(kept)
    logger.warning("%s was left unfinished; kept as %s", working_path, kept)


def torn_path(path: Path) -> Path:
    """Where what is left of an unfinished recording is kept: `x.torn.mcap`, or the next name that is free."""
    number = 0
    while (kept := path.with_name(f"{path.stem}.torn{number or ''}{path.suffix}")).exists():
        number += 1
    return kept


def _storage_error(path: Path, error: OSError) -> StorageError:
    advice = {
        errno.ENOSPC: "the disk is full: free some space or record elsewhere",
        errno.EDQUOT: "the disk quota is used up: free some space or record elsewhere",
        errno.EAGAIN: "another process is writing it: wait for its end or choose another name",
        errno.ENOENT: f"there is no folder {path.parent}: create it first",
        errno.EACCES: "permission denied: choose a folder that you may write to",
        errno.EROFS: "the disk is read-only: choose another folder",
        errno.EIO: "the disk does not answer: look at its cable and its health",
    }
    return StorageError(f"{path}: cannot be written: {advice.get(error.errno or 0, error.strerror)}")
