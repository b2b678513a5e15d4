"""The truth of a simulation, rendered beside all else: a fine one takes half a minute."""

import logging
from collections.abc import Callable
from threading import Lock, Thread

import numpy as np
from numpy.typing import NDArray

from service.leaving import leave_behind

Find = Callable[[], NDArray[np.float32] | None]
"""Gives (βH, βW) true distance of the reference view, metres, or None; for any thread."""

Take = Callable[[NDArray[np.float32] | None], None]

_log = logging.getLogger(__name__)


class TruthSearch:
    """Looks for one truth at a time, in a thread of its own; of those that wait the last alone counts."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._next: tuple[Find, Take] | None = None
        self._is_at_work = False

    def begin(self, find: Find, take: Take) -> None:
        """Have `take` called with what is found, in another thread; never, where it cannot be found."""
        with self._lock:
            self._next = find, take
            if self._is_at_work:
                return
            self._is_at_work = True
        thread = Thread(target=self._work, name="truth", daemon=True)
        thread.start()
        leave_behind(thread)

    def _work(self) -> None:
        while (asked := self._asked()) is not None:
            find, take = asked
            try:
                truth = find()
            except Exception as error:  # as a rule there is not enough memory for it
                _log.warning("the truth of the simulation cannot be had: %s", error or type(error).__name__)
                continue
            take(truth)

    def _asked(self) -> tuple[Find, Take] | None:
        with self._lock:
            asked, self._next = self._next, None
            self._is_at_work = asked is not None
            return asked
