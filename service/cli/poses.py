"""Shows how far the burst of a running service is: a bar on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from service.messages.progress import ScanProgress

if TYPE_CHECKING:
    from service.messages.decoding import Received
    from service.wire.client import Client

_BETWEEN_LINES = 1.0
"""Seconds between two lines on the same solve."""


@contextmanager
def poses_shown(client: "Client") -> Iterator[None]:
    """Follow `scan/progress` meanwhile, on standard error."""
    if not sys.stderr.isatty():
        with client.subscribe("scan/progress", _Lines()):
            yield
        return
    from rich.progress import TimeElapsedColumn

    from service.cli.terminal import bar

    with bar(TimeElapsedColumn(), "poses") as shown:
        task = shown.add_task("waiting", total=None)

        def show(received: "Received") -> None:
            told = ScanProgress.model_validate(received.value)
            if shown.tasks[task].total is None and _is_over(told):
                return
            shown.update(task, description=_doing(told), total=told.poses, completed=told.captured)

        with client.subscribe("scan/progress", show):
            yield


class _Lines:
    """One line a pose, then some of the solve."""

    def __init__(self) -> None:
        self._pose: tuple[int, int] | None = None
        self._solve = 0.0

    def __call__(self, received: "Received") -> None:
        told = ScanProgress.model_validate(received.value)
        if self._pose is None and _is_over(told):
            return
        if self._pose != (told.burst, told.captured):
            self._pose = told.burst, told.captured
            of = "" if told.poses is None else f" of {told.poses}"
            self._say(f"burst {told.burst}: pose {told.captured}{of}")
        if told.solver is not None and time.monotonic() - self._solve >= _BETWEEN_LINES:
            self._solve = time.monotonic()
            self._say(f"burst {told.solver.burst}: {_iterating(told)}")

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)


def _is_over(told: ScanProgress) -> bool:
    """Whether nothing is at work: what is kept for whoever comes late may be of long ago."""
    return told.captured == told.poses and not told.fusing and told.solver is None


def _doing(told: ScanProgress) -> str:
    if told.captured != told.poses:
        return f"burst {told.burst}"
    return _iterating(told) if told.solver is not None else "fusing" if told.fusing else "fused"


def _iterating(told: ScanProgress) -> str:
    solver = told.solver
    assert solver is not None
    objective = "" if solver.objective is None else f", objective {solver.objective:.4g}"
    gap = "" if solver.gap is None else f", gap {solver.gap:.1g}"
    return f"fusing, iteration {solver.iteration}{objective}{gap}"
