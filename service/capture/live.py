"""The configured camera by itself: opened, filmed with, closed; no fusion, nothing published."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice

from drivers.errors import EndOfRecordingError
from drivers.frame import Frame
from service.capture.configured import make_rig
from service.capture.control import Control
from service.capture.grabber import Grabber
from service.capture.motion import Operator
from service.config.sections import Configuration, StageSection


@contextmanager
def live(configuration: Configuration, operator: Operator | None = None) -> Iterator[Grabber]:
    """The configured camera, open and started; raises as `make_rig` and `Rig.open`.

    Args:
        operator: of the stage; without one the stage is not even opened.
    """
    if operator is None:
        configuration = configuration.model_copy(update={"stage": StageSection()})
    rig = make_rig(configuration, operator=operator)
    try:
        rig.open()
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
