"""Files and directories for results: whole, or not there; and names that nothing has yet."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service.errors import OutputError

_RECORDING = re.compile(r"(?P<stamp>\d{8}T\d{6}Z)(-(?P<number>\d+))?(\.torn\d*)?\.mcap(\.active)?")


def recordings_in(directory: Path) -> list[Path]:
    """The recordings of a service, oldest first: `20260131T235959Z-000017.mcap`, torn ones, those at work.

    The number rises from file to file; times, in the name or of the file, are wrong where the clock was.

    Raises:
        OSError: the directory cannot be read.
    """
    return sorted((p for p in directory.iterdir() if _RECORDING.fullmatch(p.name)), key=_order)


def recording_number(path: Path) -> int:
    """The number in the name of a recording; 0 = it has none."""
    return _order(path)[0]


def _order(path: Path) -> tuple[int, str, str]:
    found = _RECORDING.fullmatch(path.name)
    assert found is not None
    return int(found["number"] or 0), found["stamp"], path.name


def free_path(path: Path) -> Path:
    """The path, or `x-2.png`, `x-3.png`, … for `x.png` where one of its name is there already."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


@contextmanager
def made_directory(path: Path) -> Iterator[Path]:
    """Make a directory; one that was made here and is still empty after an error goes again.

    Raises:
        OutputError: it cannot be made.
    """
    existed = path.exists()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: the directory cannot be made ({error.strerror}); name another") from error
    try:
        yield path
    except BaseException:
        if not existed:
            with suppress(OSError):
                path.rmdir()
        raise


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write a file that shall be whole or not at all: it gets its name once all went well.

    Raises:
        OutputError: it cannot be written.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another place") from error
    finally:
        partial.unlink(missing_ok=True)
