"""The files in which a compiled kernel is kept: whole or not there, and from nobody but the user and root.

A kernel's index (.nbi) says in which file (.nbc) each of its overloads lies. Both are unpickled, which runs
whatever they say, and then called: so they are read only where nobody else can have written them, and each
begins with a checksum. What an overload was compiled from and for stands with it, since two processes that
compile at once may put another's in its place.
"""

import grp
import hashlib
import os
import pickle
import pwd
import stat
import tempfile
import uuid
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.serialize import dumps

_CHECKSUM = hashlib.sha256
_CHECKED = _CHECKSUM().digest_size

_FOLDER_MODE, _FILE_MODE = 0o755, 0o644
"""Whatever the umask: what others may write is not read again."""

_LARGE = 1 << 18
"""Bytes; few compiled kernels are larger."""


class KernelFiles:
    """The files of one kernel in one folder.

    Args:
        folder: where they lie.
        name: what their names begin with.
        stamp: of all that the kernel is compiled from; files with another count as not there.
    """

    def __init__(self, folder: Path, name: str, stamp: object) -> None:
        self.folder = folder
        self._name, self._stamp = name, stamp

    def load(self, key: object) -> Any:
        """What was saved under the key, or None; raises whatever a damaged file leads to."""
        name = self.index().get(key)
        if name is None:
            return None
        stamp, known, content = self._read(name)
        return content if (stamp, known) == (self._stamp, key) else None

    def save(self, key: object, content: Any) -> None:
        """Keep it; raises OSError where it cannot be written."""
        names = dict(self.index())
        number = _CHECKSUM(repr(key).encode()).hexdigest()[:16]
        name = names.setdefault(key, f"{self._name}.{number}.nbc")
        self._write(name, (self._stamp, key, content))
        self._write(f"{self._name}.nbi", (self._stamp, names))

    def clear(self) -> None:
        """Forget what was saved; raises as `save`."""
        self._write(f"{self._name}.nbi", (self._stamp, {}))

    def index(self) -> Mapping[Any, str]:
        """File names by key; empty where there is no index that can be read, or one with another stamp."""
        try:
            stamp, names = self._read(f"{self._name}.nbi")
        except Exception:
            return {}
        return names if stamp == self._stamp else {}

    def _read(self, name: str) -> Any:
        content = _read_trusted(self.folder, name)
        if _CHECKSUM(content[_CHECKED:]).digest() != content[:_CHECKED]:
            raise ValueError(f"{self.folder / name}: torn or damaged")
        return pickle.loads(content[_CHECKED:])

    def _write(self, name: str, content: Any) -> None:
        data: bytes = dumps(content)  # type: ignore[no-untyped-call]
        partial = self.folder / f"{name}.tmp.{uuid.uuid4().hex[:16]}"
        try:
            with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _FILE_MODE), "wb") as file:
                file.write(_CHECKSUM(data).digest() + data)
            partial.replace(self.folder / name)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.folder)) from error
        finally:
            with suppress(OSError):
                partial.unlink()


@cache
def fault_in_writing(folder: Path) -> str | None:
    """Why kernels cannot be kept in the folder, which is made where it is missing; None where they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=_FOLDER_MODE)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_LARGE))  # a full disk still takes empty files
        _check_trust(folder, folder.stat())
    except OSError as error:
        return f"{folder}: {error.strerror}"
    return None


def _read_trusted(folder: Path, name: str) -> bytes:
    """A file's content; raises PermissionError where another user can have written it."""
    place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _check_trust(folder, os.fstat(place))
        opened = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=place)
    finally:
        os.close(place)
    with os.fdopen(opened, "rb") as file:
        _check_trust(folder / name, os.fstat(opened))
        return file.read()


def _check_trust(path: Path, found: os.stat_result) -> None:
    if found.st_uid not in (0, os.geteuid()):
        raise PermissionError(0, "belongs to another user", str(path))
    others = stat.S_IWOTH if _is_own(found.st_gid) else stat.S_IWOTH | stat.S_IWGRP
    if found.st_mode & others:
        raise PermissionError(0, "others may write it", str(path))


@cache
def _is_own(group: int) -> bool:
    """Whether only the user, or root, is in the group: many systems give each user one of his name."""
    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}
