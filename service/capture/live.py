"""The configured camera by itself: opened, filmed with, closed; no fusion, nothing published."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from threading import current_thread, main_thread
from types import FrameType

from drivers.errors import EndOfRecordingError
from drivers.frame import Frame
from service.capture.control import Control
from service.capture.loop import Grabber
from service.capture.motion import Operator
from service.capture.rig import make_rig
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
    with _ended_by_signals():
        try:
            rig.open()
            yield Grabber(rig, configuration.camera.timeout, Control())
        finally:
            rig.close()


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let SIGTERM and a closed terminal end the command as Ctrl-C does, so that what moves is stopped."""
    if current_thread() is not main_thread():
        yield
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
