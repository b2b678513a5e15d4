"""Shows how far long work has come: a bar on a terminal, plain lines elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivers.frame import Frame
from service.capture.played import recording_of
from service.daemon import Daemon, Watch
from service.fusion.summary import BurstSummary, describe

if TYPE_CHECKING:
    from rich.progress import Progress


@contextmanager
def shown_progress(*, quiet: bool) -> Iterator[Watch]:
    """What a run reports to while in the context; on standard error, which leaves the other to the result."""
    if quiet:
        yield Watch()
    elif sys.stderr.isatty():
        from rich.progress import TimeElapsedColumn

        from service.cli.terminal import bar

        with bar(TimeElapsedColumn()) as progress:
            yield _Bar(progress)
    else:
        yield _Lines()


def total_frames(daemon: Daemon) -> int:
    """How many frames one pass has."""
    recording = recording_of(daemon.rig.camera)
    return daemon.configuration.fusion.frames if recording is None else recording.frame_count


_WARMING = "warming up: on its first run here the fusion compiles its kernels, for about two minutes"


class _Bar(Watch):
    def __init__(self, progress: "Progress") -> None:
        self._progress = progress

    def started(self, daemon: Daemon) -> None:
        self._frames = self._progress.add_task("frames", total=total_frames(daemon))
        self._maps = self._progress.add_task("bursts fused", total=None)

    def warming(self) -> None:
        self._progress.console.print(_WARMING)

    def captured(self, frame: Frame) -> None:  # noqa: ARG002
        self._progress.advance(self._frames)

    def burst(self, number: int) -> None:
        self._progress.update(self._maps, total=number)

    def fused(self, burst: BurstSummary) -> None:
        self._progress.advance(self._maps)
        self._progress.console.print(describe(burst))

    def failed(self, burst: int, reason: str) -> None:
        self._progress.console.print(f"burst {burst} could not be fused: {reason}")


class _Lines(Watch):
    def started(self, daemon: Daemon) -> None:
        self._say(f"{daemon.rig.camera.capabilities.model}: {total_frames(daemon)} frames to come")

    def warming(self) -> None:
        self._say(_WARMING)

    def burst(self, number: int) -> None:
        self._say(f"{number} bursts captured")

    def fused(self, burst: BurstSummary) -> None:
        self._say(describe(burst))

    def failed(self, burst: int, reason: str) -> None:
        self._say(f"burst {burst} could not be fused: {reason}")

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)
