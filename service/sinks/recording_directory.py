"""Where a running service keeps its recordings: files by time, the oldest deleted to keep a budget."""

import itertools
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from service.config.sections import RecordingSection
from service.errors import OutputError

MEGABYTE = 1_000_000
_NAME = re.compile(r"\d{8}T\d{6}Z(-\d+)?(\.torn\d*)?\.mcap(\.active)?")
_KEEP = ".keep"


class RecordingDirectory:
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

    def prepare(self) -> None:
        """Make the directory; raises as `next_path`."""
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._refused(error) from error

    def next_path(self) -> Path:
        """A new name, with room made for the file.

        Raises:
            OutputError: the directory cannot be made, or kept recordings fill the budget.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            self._make_room()
        except OSError as error:
            raise self._refused(error) from error
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

    def _refused(self, error: OSError) -> OutputError:
        return OutputError(
            f"{self.directory}: recordings cannot be kept here ({error.strerror}); choose another "
            "recording.directory"
        )

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


class FileSeries:
    """Files of one run, `fused.mcap`, `fused-2.mcap`, …, none of which overwrites another.

    Args:
        path: of the first.
        rotate_size: MB after which the next is begun.
        budget: MB of all; where that is exceeded the oldest goes. None = all are kept.
    """

    def __init__(self, path: Path, rotate_size: float, budget: float | None) -> None:
        self._path, self._rotate_size, self._budget = path, rotate_size, budget
        self._written: list[Path] = []

    def prepare(self) -> None:
        """Make the directory; raises `OutputError` where that cannot be done."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"{self._path.parent}: cannot be made ({error.strerror}); name another"
            ) from error

    def next_path(self) -> Path:
        """The first name that is free, with room made for the file."""
        self._make_room()
        names = itertools.chain(
            [self._path],
            (self._path.with_stem(f"{self._path.stem}-{number}") for number in itertools.count(2)),
        )
        path = next(p for p in names if not p.exists() and not p.with_name(p.name + ".active").exists())
        self._written.append(path)
        return path

    def is_full(self, size: float, age: float) -> bool:  # noqa: ARG002
        return size >= self._rotate_size * MEGABYTE

    def _make_room(self) -> None:
        if self._budget is None:
            return
        kept = [path for path in self._written if path.exists()]
        while kept and sum(p.stat().st_size for p in kept) > (self._budget - self._rotate_size) * MEGABYTE:
            kept.pop(0).unlink()
        self._written = kept


def _mark(path: Path) -> Path:
    return path.with_name(path.name + _KEEP)
