"""Files and directories for results: whole, or not there; and names that nothing has yet."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service.errors import OutputError


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
