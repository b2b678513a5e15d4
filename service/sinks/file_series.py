"""Where one run keeps what it was asked to write: files by number, none of which overwrites another."""

import itertools
from pathlib import Path

from drivers.recording import Compression
from drivers.recording.output import WORKING_SUFFIX
from service.errors import OutputError
from service.sinks.recording_directory import MEGABYTE, delete_oldest


class FileSeries:
    """Files of one run, `fused.mcap`, `fused-2.mcap`, …, none of which overwrites another.

    Args:
        path: of the first.
        rotate_size: MB after which the next is begun.
        budget: MB of all; where that is exceeded the oldest goes. None = all are kept.
    """

    compression = Compression.QUICK

    def __init__(self, path: Path, rotate_size: float, budget: float | None) -> None:
        self._path, self._rotate_size, self._budget = path, rotate_size, budget
        self._written: list[Path] = []
        numbered = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
        self._names = itertools.chain([path], numbered)

    def next_path(self) -> Path:
        """The next name that is free, with room made for the file; none is given twice.

        Raises:
            OutputError: the directory cannot be made, or cannot be read.
        """
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self.make_room(self._rotate_size)
            path = next(path for path in self._names if not path.exists() and not _working(path).exists())
        except OSError as error:
            raise OutputError(f"{self._path.parent}: cannot be written to ({error.strerror})") from error
        self._written.append(path)
        return path

    def is_full(self, size: float, age: float) -> bool:  # noqa: ARG002
        """Whether a file of `size` bytes has reached its limit."""
        return size >= self._rotate_size * MEGABYTE

    def leftovers(self) -> list[Path]:
        """What an earlier run left unfinished."""
        names = self._path.parent.glob(f"{self._path.stem}*{self._path.suffix}{WORKING_SUFFIX}")
        mine = {_working(path) for path in self._written}
        return sorted(path for path in names if path not in mine)

    def make_room(self, megabytes: float) -> None:
        """Delete the oldest of this run until so much more fits into the budget."""
        if self._budget is not None:
            self._written = [path for path in self._written if path.exists()]
            sizes = {path: path.stat().st_size for path in self._written}
            delete_oldest(sizes, sum(sizes.values()) - (self._budget - megabytes) * MEGABYTE)


def _working(path: Path) -> Path:
    return path.with_name(path.name + WORKING_SUFFIX)
