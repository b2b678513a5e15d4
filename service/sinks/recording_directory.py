"""Where a running service keeps its recordings: files by number, the oldest deleted to keep a budget."""

import logging
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.recording import Compression
from drivers.recording.index import has_footer
from drivers.recording.locks import is_used
from drivers.recording.output import WORKING_SUFFIX
from service.config.sections import RecordingSection
from service.errors import OutputError
from service.files import recording_number, recordings_in

MEGABYTE = 1_000_000
_KIND = re.compile(r"\.mcap(\.active)?$")
_KEEP = ".keep"

_log = logging.getLogger(__name__)


class RecordedFile(BaseModel):
    """A file of the recording folder."""

    model_config = ConfigDict(frozen=True)

    file: str = Field(description="Its name.")
    size: int = Field(description="Bytes.")
    modified: int = Field(description="When it was written to, ns since the epoch.")
    kept: bool = Field(description="Whether it is never deleted to make room.")
    state: Literal["whole", "written", "torn"] = Field(
        description="`written`: at work; `torn`: left unfinished, or cut; `recover` saves what it holds."
    )


class RecordingDirectory:
    """A directory of recordings `20260131T235959Z-000017.mcap`, marked to keep by an empty `….mcap.keep`.

    The number rises from file to file and says which is older: the time in the name, and that of the file
    system, are wrong where the clock was. Only files named like that are ever counted or deleted, and none
    that is marked, played or read. Room for one whole file is made before that file is begun, so the true
    peak on disk is the budget, plus what the last file runs over its limit (one burst).

    Args:
        section: directory, size and duration of a file, budget.
        now: nanoseconds since the epoch.
    """

    compression = Compression.SMALL

    def __init__(self, section: RecordingSection, now: Callable[[], int]) -> None:
        self._section, self._now = section, now
        self._changing = Lock()

    @property
    def directory(self) -> Path:
        return self._section.directory

    def next_path(self) -> Path:
        """A new name, with room made for the file.

        Raises:
            OutputError: the directory cannot be made, or what must not be deleted fills the budget.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            self.make_room(self._section.rotate_size)
            last = max(map(recording_number, self.recordings()), default=0)
        except OSError as error:
            raise OutputError(
                f"{self.directory}: recordings cannot be kept here ({error.strerror}); mend that, or choose "
                "another recording.directory"
            ) from error
        stamp = datetime.fromtimestamp(self._now() / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ")
        return self.directory / f"{stamp}-{last + 1:06d}.mcap"

    def is_full(self, size: float, age: float) -> bool:
        """Whether a file of `size` bytes, `age` seconds old, has reached its limit."""
        return size >= self._section.rotate_size * MEGABYTE or age >= self._section.rotate_duration

    def keep(self, path: Path, keep: bool = True) -> None:
        """Mark a recording, finished or not, never to be deleted; or take the mark away."""
        if keep:
            _mark(path).touch()
        else:
            _mark(path).unlink(missing_ok=True)

    def files(self, written: Path | None = None) -> list[RecordedFile]:
        """All that can be played or saved, whoever made it, newest first.

        Args:
            written: the file at work, as it is called until then.
        """
        found: list[RecordedFile] = []
        with suppress(FileNotFoundError):  # no folder yet
            for path in self.directory.iterdir():
                with suppress(FileNotFoundError):  # deleted meanwhile, to make room
                    if _KIND.search(path.name) and path.is_file():
                        found.append(_described(path, path == written))
        return sorted(found, key=lambda file: (file.modified, file.file), reverse=True)

    def recordings(self) -> list[Path]:
        """All recordings, oldest first, those being written included."""
        return recordings_in(self.directory)

    def leftovers(self) -> list[Path]:
        """Files with a working name, oldest first: being written, or left by a service that was killed."""
        return [path for path in self.recordings() if path.suffix == WORKING_SUFFIX]

    def make_room(self, megabytes: float) -> None:
        """Delete the oldest until so much more fits into the budget.

        Raises:
            OutputError: what must not be deleted leaves no room.
            OSError: the directory cannot be read.
        """
        with self._changing:
            sizes = {path: _size(path) for path in self.recordings()}
            excess = sum(sizes.values()) - (self._section.budget - megabytes) * MEGABYTE
            deletable = {path: size for path, size in sizes.items() if not _mark(path).exists()}
            if delete_oldest(deletable, excess) > 0:
                raise OutputError(
                    f"{self.directory}: recordings marked to keep, played or written leave no room for "
                    f"{megabytes:g} MB more within {self._section.budget:g} MB; move some away, remove "
                    f"their {_KEEP} marks or raise recording.budget"
                )


def delete_oldest(sizes: Mapping[Path, int], excess: float) -> float:
    """Delete files that nobody writes or reads, the first ones first.

    Args:
        sizes: bytes of each file.
        excess: bytes to be freed.

    Returns:
        Bytes that could not be freed.
    """
    for path, size in sizes.items():
        if excess <= 0:
            break
        try:
            used = is_used(path)
            if used or (used is None and path.suffix == WORKING_SUFFIX):
                continue
            path.unlink()
        except FileNotFoundError:
            pass
        except OSError as error:
            _log.warning("%s cannot be deleted: %s", path, error.strerror)
            continue
        excess -= size
    return excess


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:  # renamed or deleted meanwhile
        return 0


def _described(path: Path, is_written: bool) -> RecordedFile:
    told = path.stat()
    return RecordedFile(
        file=path.name,
        size=told.st_size,
        modified=told.st_mtime_ns,
        kept=_mark(path).exists(),
        state="written" if is_written else "whole" if _is_whole(path) else "torn",
    )


def _is_whole(path: Path) -> bool:
    """Whether it has its name and its end; by its name alone where it cannot be read."""
    if path.suffix == WORKING_SUFFIX:
        return False
    try:
        return has_footer(path)
    except FileNotFoundError:
        raise
    except OSError:
        return True


def _mark(path: Path) -> Path:
    whole = re.sub(r"\.torn\d*", "", path.name.removesuffix(WORKING_SUFFIX))
    return path.with_name(whole + _KEEP)
