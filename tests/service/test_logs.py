"""The log: what is repeated is thinned out, what differs is said."""

import json
import logging
import sys

from service.daemon.logs import JsonFormatter, RepeatFilter


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


def test_two_handlers_of_one_record_say_the_same() -> None:
    now = [0.0]
    filters = [RepeatFilter(lambda: now[0]) for _ in range(2)]
    said: list[list[str]] = [[], []]
    for tenth in range(250):
        now[0] = tenth / 10
        record = logging.LogRecord("service", logging.WARNING, "a.py", 1, "no %s", ("frame",), None)
        for which, one in enumerate(filters):
            if one.filter(record):
                said[which].append(record.getMessage())
    assert said[0] == said[1] == ["no frame", *["no frame (and 99 times more since)"] * 2]


def test_json_has_one_object_a_line_with_what_a_machine_looks_for() -> None:
    formatter = JsonFormatter()
    record = logging.LogRecord("service.daemon", logging.WARNING, "a.py", 1, 'β = %s\n"x"', (4,), None)
    record.created, record.repeated = 1_700_000_000.25, 3
    line = formatter.format(record)
    assert "\n" not in line
    assert json.loads(line) == {
        "time": "2023-11-14T22:13:20.250Z",
        "level": "warning",
        "logger": "service.daemon",
        "message": 'β = 4\n"x"',
        "repeated": 3,
    }
    try:
        raise ValueError("why")
    except ValueError:
        failed = logging.LogRecord("service", logging.ERROR, "a.py", 1, "it failed", None, sys.exc_info())
    assert "ValueError: why" in json.loads(formatter.format(failed))["traceback"]
