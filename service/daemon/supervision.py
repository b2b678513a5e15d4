"""What the maps themselves say of the stage and of the camera."""

from collections.abc import Callable

from service.daemon.drift import DriftMeter
from service.daemon.motion_watch import MotionWatch
from service.daemon.states import States
from service.messages.events import Event, MapFused
from service.messages.status import Drift


class Supervision:
    """Judges by every map; a recording says nothing of the devices at hand.

    Args:
        states: where it is said what is wrong.
        is_live: whether frames come from the devices.
    """

    def __init__(self, states: States, is_live: Callable[[], bool]) -> None:
        self._motion, self._drift, self._is_live = MotionWatch(states), DriftMeter(), is_live

    @property
    def drift(self) -> Drift | None:
        """Of the distance of what stands still."""
        return self._drift.latest

    def note(self, event: Event) -> None:
        """Judge by an event; those that are no maps say nothing."""
        if isinstance(event, MapFused) and self._is_live():
            self._motion.note(event.map.report)
            self._drift.note(event.map)
