"""The service's log as events, its form as JSON, and the thinning out of repeated warnings."""

import json
import logging
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from service.messages.events import Event, Logged

LOGGERS = ("service", "drivers", "solver")
"""Of this program."""

_QUIET = 10.0
"""Seconds in which the same warning is not said again."""

_DIFFERENT = 5
"""Different warnings from one place that are said in that time."""


class RepeatFilter(logging.Filter):
    """Thins out what is repeated, and says how often it came.

    Within ten seconds a warning is said once, and of those from one place in the code, however they differ
    in names and numbers, five.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._said: dict[tuple[str, int], deque[tuple[float, str]]] = {}
        self._held: dict[tuple[str, int], int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        if record.levelno < logging.WARNING:
            return True
        # Two handlers see the same record, each behind its filter: what one has added is no other text.
        text: str = record.__dict__.setdefault("as_said", record.getMessage())
        place, now = (record.pathname, record.lineno), self._clock()
        said = self._said.setdefault(place, deque(maxlen=_DIFFERENT))
        while said and now - said[0][0] >= _QUIET:
            said.popleft()
        if len(said) == _DIFFERENT or any(text == former for _, former in said):
            self._held[place] = self._held.get(place, 0) + 1
            return False
        said.append((now, text))
        held = self._held.pop(place, 0)
        if held:
            record.msg, record.args = f"{text} (and {held} times more since)", None
            record.repeated = held
        return True


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time (UTC, ISO 8601), level, logger, message; where they are, also how often it
    was repeated since and the traceback."""

    def format(self, record: logging.LogRecord) -> str:
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        told: dict[str, Any] = {
            "time": at.replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if (repeated := getattr(record, "repeated", 0)) > 0:
            told["repeated"] = repeated
        if record.exc_info:
            told["traceback"] = self.formatException(record.exc_info)
        return json.dumps(told, ensure_ascii=False)


class _Emitting(logging.Handler):
    def __init__(self, emit: Callable[[Event], None]) -> None:
        super().__init__(logging.INFO)
        self._hand_over = emit

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._hand_over(Logged(record))
        except Exception:
            self.handleError(record)


@contextmanager
def logged_events(emit: Callable[[Event], None]) -> Iterator[None]:
    """Emit this service's records, from INFO on, as events while in the context."""
    handler = _Emitting(emit)
    handler.addFilter(RepeatFilter())
    for name in LOGGERS:
        logging.getLogger(name).addHandler(handler)
        logging.getLogger(name).setLevel(logging.INFO)
    try:
        yield
    finally:
        for name in LOGGERS:
            logging.getLogger(name).removeHandler(handler)
