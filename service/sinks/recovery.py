"""Makes whole files of recordings that a killed service left unfinished, beside the recording itself."""

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event as Flag
from threading import Thread

from drivers.errors import DriverError
from drivers.recording import Recording, recover, torn_path
from drivers.recording.locks import is_used
from drivers.recording.output import WORKING_SUFFIX
from service.errors import OutputError

_WATCHED = 3.0
"""Seconds in which a file that is being written grows: the status alone comes once a second."""

# An error that is logged as it is keeps the frames it passed, and in them a recording and its lock.
_log = logging.getLogger(__name__)


class Recovery:
    """Goes once through what was left, in a thread of its own.

    A whole file takes the name that it would have had; the torn one goes once that is done. What holds
    nothing, or finds no room, is set aside as `….torn.mcap`.

    Args:
        left: `.active` files that may have been left; those that somebody writes stay as they are.
        make_room: within the budget, for so many megabytes; raises `OutputError` where that cannot be done.
    """

    def __init__(self, left: Sequence[Path], make_room: Callable[[float], None]) -> None:
        self._left, self._make_room = left, make_room
        self._stopping = Flag()
        self._thread = Thread(target=self._run, name="recovery", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout: float = 1.0) -> None:
        """Give up; what was begun is begun anew at the next start."""
        self._stopping.set()
        self._thread.join(timeout)

    def wait(self, timeout: float) -> bool:
        """Whether it is done within `timeout` seconds."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        for path in self._left:
            try:
                if not self._is_written(path) and not self._stopping.is_set():
                    self._recover(path)
            except (OSError, DriverError, OutputError) as error:
                _log.warning("%s was left unfinished and is kept as it is: %s", path, str(error))

    def _is_written(self, path: Path) -> bool:
        used = is_used(path)
        if used is not None:
            return used
        size = path.stat().st_size
        deadline = time.monotonic() + _WATCHED
        while time.monotonic() < deadline and not self._stopping.wait(0.1):
            if path.stat().st_size != size:
                return True
        return False

    def _recover(self, active: Path) -> None:
        whole = active.with_name(active.name.removesuffix(WORKING_SUFFIX))
        torn = self._set_aside(active, whole)
        if whole.exists():
            _log.warning("%s was left unfinished; it was set aside as %s", active, torn)
            return
        _log.warning("%s was left unfinished; what it holds is made a whole file of", whole)
        try:
            self._make_room(torn.stat().st_size / 1e6)
            recording = Recording(torn)
            recover(recording, whole, self._stopping.is_set)
        except InterruptedError:
            torn.rename(active)
            return
        except (DriverError, OutputError) as error:
            _log.warning("%s: cannot be made a whole file of (%s); it was set aside", torn, str(error))
            return
        lost = f"; lost: {recording.damage}" if recording.damage is not None else ""
        _log.warning("%s: %d frames were saved%s", whole, recording.frame_count, lost)
        del recording  # and with it the lock
        while is_used(torn) and not self._stopping.wait(0.1):
            continue  # somebody looks for what was interrupted
        with suppress(OSError):
            torn.unlink()

    @staticmethod
    def _set_aside(active: Path, whole: Path) -> Path:
        """The torn file under a name of its own: given now, or by a recovery that was killed over it."""
        earlier = sorted(whole.parent.glob(f"{whole.stem}.torn*.mcap"))
        if earlier and not whole.exists():
            active.unlink()  # the beginning of a copy
            return earlier[0]
        torn = torn_path(whole)
        active.rename(torn)
        return torn
