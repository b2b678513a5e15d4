"""Whoever waits for a frame goes before all else: a late map is late, a late frame is lost."""

import os
import sys
from contextlib import suppress
from threading import get_native_id
from types import TracebackType
from typing import Self

_AHEAD = 10
"""Taken off the number of the priority (nice(2))."""


class Foremost:
    """A context in which the calling thread goes before others, where the system permits that.

    Linux keeps a priority for each thread. Raising it takes the capability SYS_NICE, or a limit on niceness
    (RLIMIT_NICE, `LimitNICE` in a systemd unit) that is low enough; elsewhere nothing changes.

    Attributes:
        is_permitted: whether it does; assumed until it was tried.
    """

    def __init__(self) -> None:
        self.is_permitted = sys.platform == "linux"
        self._before: int | None = None

    def __enter__(self) -> Self:
        if self.is_permitted:
            thread = get_native_id()
            try:
                before = os.getpriority(os.PRIO_PROCESS, thread)
                os.setpriority(os.PRIO_PROCESS, thread, before - _AHEAD)
                self._before = before
            except OSError:
                self.is_permitted = False
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, get_native_id(), self._before)
            self._before = None
