"""The configured camera by itself: opened, filmed with, closed; no fusion, nothing published."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice

from drivers.errors import EndOfRecordingError
from drivers.frame import Frame
from service.capture.control import Control
from service.capture.loop import Grabber
from service.capture.rig import make_rig
from service.config.sections import Configuration


@contextmanager
def live(configuration: Configuration) -> Iterator[Grabber]:
    """The configured camera on its stage, open and started; raises as `make_rig` and `Rig.open`."""
    rig = make_rig(configuration)
    rig.open()
    try:
        yield Grabber(rig, configuration.camera.timeout, Control())
    finally:
        rig.close()


def filmed(grabber: Grabber, count: int | None = None, seconds: float | None = None) -> Iterator[Frame]:
    """Frames as they come, until there are `count`, `seconds` are over, or a played recording ends."""
    clock = grabber.rig.clock
    end = None if seconds is None else clock.now() + round(seconds * 1e9)

    def forever() -> Iterator[Frame]:
        while end is None or clock.now() < end:
            try:
                yield grabber.grab()
            except EndOfRecordingError:
                return

    return islice(forever(), count)
