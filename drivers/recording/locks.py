"""Who writes a recording and who reads it: locks that end with the process (flock(2))."""

import errno
import fcntl
import logging
import os
import time
import weakref
from pathlib import Path

_NO_LOCKS = frozenset({errno.EOPNOTSUPP, errno.ENOLCK, errno.ENOSYS, errno.EINVAL})
"""What flock(2) says on shares that have none."""

_ATTEMPTS, _PAUSE = 3, 0.005
"""`is_used` holds a file for an instant, its writer for good."""

_log = logging.getLogger(__name__)


def claim(descriptor: int, path: Path) -> None:
    """Lock an open file for its writer.

    A share without locks is told of, once, and written without.

    Raises:
        BlockingIOError: somebody else writes or reads it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        _log.warning("%s has no file locks: see to it that only one service records there", path.parent)


def hold(reader: object, path: Path) -> None:
    """Lock a file for as long as `reader` exists, so that nobody who asks `is_used` deletes it.

    Does nothing where there are no locks, or where it is being written.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:  # told by who reads it
        return
    weakref.finalize(reader, os.close, descriptor)
    for _ in range(_ATTEMPTS):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(_PAUSE)
        except OSError:
            return
        else:
            return


def is_used(path: Path) -> bool | None:
    """Whether anybody writes or reads a file; None where there are no locks to tell.

    Raises:
        OSError: it cannot be opened.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return None
        raise
    finally:
        os.close(descriptor)
    return False
