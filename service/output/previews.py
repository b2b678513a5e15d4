"""Draws the picture of each burst in a thread of its own: nothing else has to wait a second for it."""

import logging
from pathlib import Path
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from service.fusion.fusion import FusedBurst
from service.output.directory import free_path
from service.output.preview import write_preview
from service.wire.outbox import Outbox

_WAITING = 2
"""Maps of 7 MB each that may wait; live, the oldest is not drawn."""

_log = logging.getLogger(__name__)


class Previews:
    """A directory of pictures `burst-0007.png`; one that is there already is never written over.

    Args:
        directory: made if need be.
        truth: true distance (βH, βW) of the reference view, or None.
        lossless: `draw` waits while too many maps wait.
    """

    def __init__(self, directory: Path, truth: NDArray[np.float32] | None, *, lossless: bool = False) -> None:
        self._directory, self._truth = directory, truth
        self.written: list[Path] = []
        self.failed: list[str] = []
        self._outbox: Outbox[FusedBurst] = Outbox(_WAITING, 1 << 40, lossless=lossless)
        self._thread = Thread(target=self._run, name="previews", daemon=True)
        directory.mkdir(parents=True, exist_ok=True)
        self._thread.start()

    def draw(self, result: FusedBurst) -> None:
        """Queue a map; never waits unless lossless."""
        self._outbox.put(result, 0)

    def close(self) -> None:
        """Draw what still waits and end."""
        self._outbox.close()
        self._thread.join()

    def _run(self) -> None:
        while (result := self._outbox.get()) is not None:
            path = free_path(self._directory / f"burst-{result.report.burst:04d}.png")
            try:
                write_preview(path, result, self._truth)
            except Exception as error:  # a picture is not worth the run; what was lost is told at the end
                _log.error("%s: the preview could not be drawn: %s", path, error)
                self.failed.append(str(path))
            else:
                self.written.append(path)
