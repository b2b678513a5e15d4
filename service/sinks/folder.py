"""Files of the recording folder, named from afar: none outside it is ever touched."""

from pathlib import Path

from service.errors import InvalidArgumentError, NotFoundError, PermissionDeniedError


def found_in(folder: Path, name: str) -> Path:
    """The file of that name in a folder, links followed.

    Raises:
        InvalidArgumentError: no name that a file can have.
        PermissionDeniedError: it is, or leads, outside the folder.
        NotFoundError: there is no such file.
    """
    root = folder.resolve()
    try:
        path = (root / name).resolve()
        is_file = path.is_file()
    except (OSError, ValueError) as error:
        raise InvalidArgumentError(f"{name[:80]!r} is no name of a file ({error})") from error
    if not path.is_relative_to(root):
        raise PermissionDeniedError(f"{name!r} is outside the recording folder; name a file in it")
    if not is_file:
        raise NotFoundError(f"there is no file {name!r} in the recording folder; cmd/record list shows all")
    return path
