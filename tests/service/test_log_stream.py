"""The log on standard output, whose reader may stop for a while."""

import logging
import os

from service.daemon.log_stream import StreamLog

ROOM = 10


def record(text: str) -> logging.LogRecord:
    return logging.LogRecord("service", logging.INFO, "a.py", 1, "%s", (text,), None)


def test_a_reader_that_stops_holds_nobody_up_and_what_it_missed_is_counted() -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream, os.fdopen(reading) as reader:
        log = StreamLog(stream, ROOM)
        line = "x" * 1000
        for _ in range(500):  # far more than a pipe and the queue hold; a log that waits would end here
            log.emit(record(line))
        kept = 0
        while not log._lines.empty():
            assert reader.readline().strip() == line
            kept += 1
        log.emit(record("the reader is back"))
        told = reader.readline().strip()
        while told == line:
            kept += 1
            told = reader.readline().strip()
        assert told == f"{500 - kept} lines of the log were lost: nobody read them"
        assert kept >= ROOM
        assert reader.readline().strip() == "the reader is back"


def test_all_is_written_in_the_end() -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream, os.fdopen(reading) as reader:
        log = StreamLog(stream)
        for number in range(100):
            log.emit(record(f"line {number}"))
        log.flush()
        os.set_blocking(reading, False)
        assert reader.read().splitlines() == [f"line {number}" for number in range(100)]


def test_a_closed_stream_is_no_fault() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    log = StreamLog(os.fdopen(writing, "w", buffering=1))
    for _ in range(3):
        log.emit(record("nobody hears"))
    log.flush()
    assert log._lines.empty()
