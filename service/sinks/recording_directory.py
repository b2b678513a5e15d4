"""Where a running service keeps its recordings: files by time, the oldest deleted to keep a budget."""

import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from service.config.sections import RecordingSection
from service.errors import OutputError

MEGABYTE = 1_000_000
_NAME = re.compile(r"\d{8}T\d{6}Z(-\d+)?(\.torn\d*)?\.mcap(\.active)?")
_KEEP = ".keep"


class Shelf:
    """A directory of recordings `20260131T235959Z.mcap`, each marked to keep by an empty file `….mcap.keep`.

    Only files named like that are ever counted or deleted. Room for one whole file is made before that file
    is begun, so the true peak on disk is the budget, plus what the last file runs over its limit (one burst).

    Args:
        section: directory, size and duration of a file, budget.
        now: nanoseconds since the epoch.
    """

    def __init__(self, section: RecordingSection, now: Callable[[], int]) -> None:
        self._section, self._now = section, now

    @property
    def directory(self) -> Path:
        return self._section.directory

    def next_path(self) -> Path:
        """A new name, with room made for the file.

        Raises:
            OutputError: the directory cannot be made, or kept recordings fill the budget.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            self._make_room()
        except OSError as error:
            raise OutputError(
                f"{self.directory}: recordings cannot be kept here ({error.strerror}); choose another "
                f"recording.directory"
            ) from error
        stem = datetime.fromtimestamp(self._now() / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ")
        names = [f"{stem}.mcap", *(f"{stem}-{number}.mcap" for number in range(2, 100))]
        taken = {path.name.removesuffix(".active") for path in self.directory.iterdir()}
        return self.directory / next(name for name in names if name not in taken)

    def is_full(self, size: float, age: float) -> bool:
        """Whether a file of `size` bytes, `age` seconds old, has reached its limit."""
        return size >= self._section.rotate_size * MEGABYTE or age >= self._section.rotate_duration

    def keep(self, path: Path) -> None:
        """Mark a recording, finished or not, never to be deleted."""
        _mark(path).touch()

    def recordings(self) -> list[Path]:
        """All recordings, oldest first, those being written included."""
        found = [path for path in self.directory.iterdir() if _NAME.fullmatch(path.name)]
        return sorted(found, key=lambda path: (path.stat().st_mtime_ns, path.name))

    def _make_room(self) -> None:
        sizes = {path: path.stat().st_size for path in self.recordings()}
        excess = sum(sizes.values()) - (self._section.budget - self._section.rotate_size) * MEGABYTE
        for path, size in sizes.items():
            if excess > 0 and path.suffix == ".mcap" and not _mark(path).exists():
                path.unlink()
                excess -= size
        if excess > 0:
            raise OutputError(
                f"{self.directory}: recordings marked to keep leave no room for "
                f"{self._section.rotate_size:g} MB more within {self._section.budget:g} MB; move some away, "
                f"remove their {_KEEP} marks or raise recording.budget"
            )


class SingleFile:
    """One file of a given name, however large."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def next_path(self) -> Path:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        return self._path

    def is_full(self, size: float, age: float) -> bool:  # noqa: ARG002
        return False

    def keep(self, path: Path) -> None:
        """Nothing is ever deleted here."""


def _mark(path: Path) -> Path:
    return path.with_name(path.name + _KEEP)
