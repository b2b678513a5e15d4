"""The service's log: to standard output and as events; repeated warnings are thinned out."""

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from service.messages.events import Event, Logged

_LOGGERS = ("service", "drivers", "solver")
_QUIET = 10.0
"""Seconds in which the same message is not said again."""


class RepeatFilter(logging.Filter):
    """Lets a message (by its place in the code) through once in ten seconds, and says how often it came."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._said: dict[tuple[str, int], float] = {}
        self._held: dict[tuple[str, int], int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        place = record.pathname, record.lineno
        now = self._clock()
        if now - self._said.get(place, -_QUIET) < _QUIET and record.levelno >= logging.WARNING:
            self._held[place] = self._held.get(place, 0) + 1
            return False
        self._said[place] = now
        held = self._held.pop(place, 0)
        if held:
            record.msg = f"{record.getMessage()} (and {held} times more since)"
            record.args = None
        return True


class _Emitting(logging.Handler):
    def __init__(self, emit: Callable[[Event], None]) -> None:
        super().__init__(logging.INFO)
        self._hand_over = emit

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._hand_over(Logged(record))
        except Exception:
            self.handleError(record)


def log_to_stream(level: int) -> None:
    """Log this service's records of at least `level` to standard output, time first (to the error stream
    where only warnings are wanted: standard output then belongs to the result)."""
    logging.raiseExceptions = False  # a closed pipe at the other end is no reason to fill the error stream
    handler = logging.StreamHandler(sys.stderr if level >= logging.WARNING else sys.stdout)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    handler.addFilter(RepeatFilter())
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers[:] = [handler]
        logger.setLevel(min(level, logging.INFO))
        handler.setLevel(level)


@contextmanager
def logged_events(emit: Callable[[Event], None]) -> Iterator[None]:
    """Emit this service's records, from INFO on, as events while in the context."""
    handler = _Emitting(emit)
    handler.addFilter(RepeatFilter())
    for name in _LOGGERS:
        logging.getLogger(name).addHandler(handler)
        logging.getLogger(name).setLevel(logging.INFO)
    try:
        yield
    finally:
        for name in _LOGGERS:
            logging.getLogger(name).removeHandler(handler)
