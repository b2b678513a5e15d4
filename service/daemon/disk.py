"""The disk that recordings go to: how much room it has, and for how long."""

import shutil
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from service.config.sections import RecordingSection
from service.daemon.heartbeat import Heartbeat
from service.files import recordings_in
from service.messages.status import DiskState, RecorderState

_MEGABYTE = 1_000_000
_INTERVAL = 2.0
_STALE = 10.0
"""Seconds after which a disk that does not answer counts as unknown."""
_WINDOW = 60.0
"""Seconds over which the rate is taken: files grow in chunks."""
_SHORTEST = 3.0


class DiskWatch:
    """Looks at the disk in a thread of its own: a share that hangs shall hold up nobody.

    Args:
        section: where recordings go, and how many bytes they may take.
        clock: seconds.
    """

    def __init__(self, section: RecordingSection, clock: Callable[[], float] = time.monotonic) -> None:
        self._section, self._clock = section, clock
        self._seen: tuple[float, int, int, int] | None = None
        self._growth = _Growth()
        self._looks = Heartbeat(self._try, _INTERVAL, name="disk", patience=0.0)  # it may hang with its disk

    def __enter__(self) -> Self:
        self._looks.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._looks.__exit__(kind, error, trace)

    def state(self, recorder: RecorderState | None) -> DiskState | None:
        """What is known now; None where the disk does not tell.

        Args:
            recorder: what is recorded.
        """
        now, seen = self._clock(), self._seen
        rate = self._growth.rate(now, recorder)
        if seen is None or now - seen[0] > _STALE:
            return None
        _, free, total, used = seen
        left = min(free, max(0.0, self._section.budget * _MEGABYTE - used))
        return DiskState(
            directory=str(self._section.directory),
            free=free,
            total=total,
            rate=rate,
            minutes=left / rate / 60 if rate else None,
        )

    def look(self) -> None:
        """Ask the disk."""
        directory = self._section.directory.absolute()
        there = next(path for path in (directory, *directory.parents) if path.exists())
        usage = shutil.disk_usage(there)
        self._seen = self._clock(), usage.free, usage.total, _used(directory)

    def _try(self) -> None:
        try:
            self.look()
        except OSError:
            self._seen = None


class _Growth:
    """How fast a recorder writes."""

    def __init__(self) -> None:
        self._written = 0
        self._last: tuple[str | None, int] = None, 0
        self._samples: deque[tuple[float, int]] = deque()

    def rate(self, now: float, recorder: RecorderState | None) -> float | None:
        """Bytes a second; None where nothing is recorded, or not for long enough."""
        if recorder is None or not recorder.recording:
            self._samples.clear()
            return None
        file, size = self._last
        self._last = recorder.file, recorder.size
        self._written += max(0, recorder.size - size) if recorder.file == file else recorder.size
        self._samples.append((now, self._written))
        while now - self._samples[0][0] > _WINDOW:
            self._samples.popleft()
        began, before = self._samples[0]
        return (self._written - before) / (now - began) if now - began >= _SHORTEST else None


def _used(directory: Path) -> int:
    if not directory.is_dir():
        return 0
    sizes = []
    for path in recordings_in(directory):
        try:
            sizes.append(path.stat().st_size)
        except FileNotFoundError:  # renamed or deleted meanwhile
            continue
    return sum(sizes)
