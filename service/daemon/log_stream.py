"""A log to standard output that holds nobody up: a terminal may be paused, a pipe's reader stopped."""

import logging
import sys
from queue import Full, Queue
from threading import Thread
from typing import Literal, TextIO

from service.daemon.logs import LOGGERS, JsonFormatter, RepeatFilter

_ROOM = 1000
"""Lines that wait for a reader; those after them are lost, and counted."""

_PARTING = 0.5
"""Seconds that a reader gets for what waits at the end."""


class StreamLog(logging.Handler):
    """Writes lines in a thread of its own.

    Args:
        stream: to write to.
        room: lines that wait; those after them are counted, and told once there is room again.
    """

    def __init__(self, stream: TextIO, room: int = _ROOM) -> None:
        super().__init__()
        self._stream = stream
        self._lines: Queue[str] = Queue(room)
        self._lost = 0
        Thread(target=self._write, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        try:
            lost = self._lost
            if lost:
                self._lines.put_nowait(f"{lost} lines of the log were lost: nobody read them")
                self._lost -= lost
            self._lines.put_nowait(self.format(record))
        except Full:
            self._lost += 1
        except Exception:
            self.handleError(record)

    def flush(self) -> None:
        """Wait until all is written, half a second at most."""
        with self._lines.all_tasks_done:
            self._lines.all_tasks_done.wait_for(lambda: not self._lines.unfinished_tasks, _PARTING)

    def _write(self) -> None:
        while True:
            line = self._lines.get()
            try:
                print(line, file=self._stream, flush=True)
            except (OSError, ValueError):
                pass  # nobody reads any more
            finally:
                self._lines.task_done()


def log_to_stream(level: int, style: Literal["text", "json"] = "text") -> None:
    """Log this service's records of at least `level` to standard output, time first (to the error stream
    where only warnings are wanted: standard output then belongs to the result)."""
    logging.raiseExceptions = False  # a closed pipe at the other end is no reason to fill the error stream
    handler = StreamLog(sys.stderr if level >= logging.WARNING else sys.stdout)
    text = logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s")
    handler.setFormatter(text if style == "text" else JsonFormatter())
    handler.addFilter(RepeatFilter())
    for name in LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers[:] = [handler]
        logger.setLevel(min(level, logging.INFO))
        handler.setLevel(level)
