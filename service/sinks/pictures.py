"""A picture of each map, drawn in a process of low priority: nothing else has to wait for it."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.errors import OutputError
from service.files import free_path
from service.messages.events import Event, MapFused
from service.messages.map import FusedMap
from service.messages.quality import Errors
from service.messages.summary import summary_of
from service.processes.worker import Worker
from service.sinks.sink import Room, Sink

_NICENESS, _NICENESS_LOSSLESS = 15, 5
"""Added to the priority's number: live nothing waits for a picture; a lossless run does, as for its maps."""

_TIMEOUT = 60.0
"""Seconds for one picture; it takes a fraction of one, the first of a process some seconds."""

_PENDING = 6


@dataclass(frozen=True, slots=True)
class Drawing:
    """What is to be drawn, and where the picture goes."""

    map: FusedMap
    truth: NDArray[np.float32] | None
    errors: Errors | None
    path: Path


class Pictures(Sink):
    """A directory of pictures `burst-0007.png`, none of which overwrites another.

    Args:
        directory: made if need be.
        keep: pictures kept; the oldest of this run goes. None = all.
        lossless: the run waits for them.
    """

    wants = (MapFused,)
    droppable = (MapFused,)
    room = Room(_PENDING, 1 << 40)
    """Maps of 7 MB each; live, the newest are drawn."""
    newest_suffice = True
    slowest = 1.5 * _TIMEOUT
    """The process that draws gives way to all others, and is itself given up after its own time."""

    def __init__(self, directory: Path, *, keep: int | None = None, lossless: bool = False) -> None:
        super().__init__()
        self._directory, self._keep = directory, keep
        self._written: deque[Path] = deque()
        self._worker = Worker(
            "process that draws",
            "service.sinks.pictures:drawing",
            niceness=_NICENESS_LOSSLESS if lossless else _NICENESS,
            threads=1,
            cancelled=self.abandoned.is_set,
        )

    def open(self) -> None:
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"{self._directory}: cannot be made ({error.strerror}); name another"
            ) from error
        self._worker.start()

    def take(self, event: Event) -> None:
        assert isinstance(event, MapFused)
        path = free_path(self._directory / f"burst-{event.map.report.burst:04d}.png")
        fault = self._worker.ask(Drawing(event.map, event.truth, summary_of(event).errors, path), _TIMEOUT)
        if fault is not None:
            raise OutputError(f"{path}: the picture could not be drawn: {fault}")
        self._written.append(path)
        if self._keep is not None and len(self._written) > self._keep:
            self._written.popleft().unlink(missing_ok=True)

    def close(self) -> None:
        self._worker.kill()

    def abandon(self) -> None:
        self._worker.kill()

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(str(path) for path in self._written)


def drawing() -> Callable[[Drawing], str | None]:
    """What draws each request; it answers what went wrong, or None."""
    from service.sinks.drawing import write_preview

    def draw(request: Drawing) -> str | None:
        try:
            write_preview(request.path, request.map, request.truth, request.errors)
        except Exception as error:  # the process lives on and draws the next
            return f"{type(error).__name__}: {error}"
        return None

    return draw
