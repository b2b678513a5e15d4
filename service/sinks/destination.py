"""Where recordings go."""

from pathlib import Path
from typing import Protocol

from drivers.recording import Compression
from service.sinks.recording_file import RecordingFile

_OVERDUE = 1.1
"""A file is ended between two bursts, and in the middle of one only when it is a tenth over its limit."""


class Destination(Protocol):
    """Where files go, how small they are made, when the next one is due, and what was left unfinished."""

    @property
    def compression(self) -> Compression: ...

    def next_path(self) -> Path: ...
    def is_full(self, size: float, age: float) -> bool: ...
    def leftovers(self) -> list[Path]: ...
    def make_room(self, megabytes: float) -> None: ...


def is_over(destination: Destination, file: RecordingFile, begins_burst: bool) -> bool:
    """Whether a file has to end before what comes next, which may begin a burst."""
    size, age = file.size, file.age
    if begins_burst and destination.is_full(size, age):
        return True
    return destination.is_full(size / _OVERDUE, age / _OVERDUE)
