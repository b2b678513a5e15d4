"""Shows how far the burst of a running service is: a bar on a terminal, plain lines elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from service.messages.progress import ScanProgress

if TYPE_CHECKING:
    from service.messages.decoding import Received
    from service.wire.client import Client


@contextmanager
def poses_shown(client: "Client") -> Iterator[None]:
    """Follow `scan/progress` meanwhile, on standard error."""
    if not sys.stderr.isatty():
        with client.subscribe("scan/progress", _line):
            yield
        return
    from rich.progress import TimeElapsedColumn

    from service.cli.terminal import bar

    with bar(TimeElapsedColumn(), "poses") as shown:
        task = shown.add_task("waiting", total=None)

        def show(received: "Received") -> None:
            told = ScanProgress.model_validate(received.value)
            what = "fusing" if told.captured == told.poses else f"burst {told.burst}"
            shown.update(task, description=what, total=told.poses, completed=told.captured)

        with client.subscribe("scan/progress", show):
            yield


def _line(received: "Received") -> None:
    told = ScanProgress.model_validate(received.value)
    of = "" if told.poses is None else f" of {told.poses}"
    print(f"burst {told.burst}: pose {told.captured}{of}", file=sys.stderr, flush=True)
