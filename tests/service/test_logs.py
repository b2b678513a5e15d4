"""The log: what is repeated is thinned out, what differs is said."""

import logging

from service.daemon.logs import RepeatFilter


class Log:
    def __init__(self) -> None:
        self.now = 0.0
        self.said: list[str] = []
        self._filter = RepeatFilter(lambda: self.now)

    def warn(self, text: str, line: int = 1, level: int = logging.WARNING) -> None:
        record = logging.LogRecord("service", level, "a.py", line, "%s", (text,), None)
        if self._filter.filter(record):
            self.said.append(record.getMessage())


def test_the_same_warning_is_said_once_in_ten_seconds_with_how_often_it_came() -> None:
    log = Log()
    for tenth in range(250):
        log.now = tenth / 10
        log.warn("no frame within 2 s")
    assert log.said == [
        "no frame within 2 s",
        "no frame within 2 s (and 99 times more since)",
        "no frame within 2 s (and 99 times more since)",
    ]


def test_warnings_of_different_things_are_all_said_but_a_flood_is_not() -> None:
    log = Log()
    for number in range(3):
        log.warn(f"{number}.mcap was left unfinished")
    assert len(log.said) == 3
    for number in range(1000):
        log.now = number / 100
        log.warn(f"next attempt in {number} s", line=2)
    assert len(log.said) == 3 + 5


def test_what_is_no_warning_is_always_said() -> None:
    log = Log()
    for _ in range(20):
        log.warn("burst fused", level=logging.INFO)
    assert len(log.said) == 20
