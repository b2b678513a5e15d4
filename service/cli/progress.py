"""Shows how far a run has come: a bar on a terminal, plain lines elsewhere."""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from service.messages.events import (
    BurstCaptured,
    DevicesOpened,
    Event,
    FrameCaptured,
    FusionFailed,
    MapFused,
    StateChanged,
)
from service.messages.summary import describe, summary_of
from service.sinks.sink import Room, Sink

if TYPE_CHECKING:
    from rich.progress import Progress


def progress_sink() -> Callable[[], Sink]:
    """What shows progress on standard error, which leaves the other to the result."""
    return ProgressBar if sys.stderr.isatty() else ProgressLines


class _Progress(Sink):
    wants = (DevicesOpened, FrameCaptured, BurstCaptured, MapFused, FusionFailed, StateChanged)
    droppable = (FrameCaptured, BurstCaptured)
    room = Room(10_000, 256 << 20)


class ProgressBar(_Progress):
    """One bar over the frames, one over the maps."""

    def open(self) -> None:
        from rich.progress import TimeElapsedColumn

        from service.cli.terminal import bar

        self._progress: Progress = bar(TimeElapsedColumn())
        self._frames = self._progress.add_task("frames", total=None)
        self._maps = self._progress.add_task("maps", total=None)
        self._progress.start()

    def take(self, event: Event) -> None:
        if isinstance(event, DevicesOpened):
            self._progress.update(self._frames, total=event.frames)
        elif isinstance(event, FrameCaptured):
            self._progress.advance(self._frames)
        elif isinstance(event, BurstCaptured):
            self._progress.update(self._maps, total=event.number)
        elif isinstance(event, MapFused):
            self._progress.advance(self._maps)
            self._say(describe(summary_of(event)))
        elif isinstance(event, FusionFailed):
            self._say(f"number {event.number} could not be fused: {event.reason}")
        elif isinstance(event, StateChanged) and event.state in ("starting", "recovering"):
            self._say(f"{event.state}: {event.reason}")

    def close(self) -> None:
        self._progress.stop()

    def _say(self, line: str) -> None:
        self._progress.console.print(line)


class ProgressLines(_Progress):
    """A line for whatever is worth one."""

    def take(self, event: Event) -> None:
        if isinstance(event, DevicesOpened):
            many = "frames" if event.frames is None else f"{event.frames} frames"
            self._say(f"{event.model}: {many} to come")
        elif isinstance(event, BurstCaptured):
            self._say(f"{event.number} bursts captured")
        elif isinstance(event, MapFused):
            self._say(describe(summary_of(event)))
        elif isinstance(event, FusionFailed):
            self._say(f"number {event.number} could not be fused: {event.reason}")
        elif isinstance(event, StateChanged) and event.state in ("starting", "recovering"):
            self._say(f"{event.state}: {event.reason}")

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)
