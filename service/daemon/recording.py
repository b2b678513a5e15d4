"""The recorder of a service: there from the start, and begun anew where it shall record otherwise."""

from service.config.sections import RecordingSection
from service.errors import SinkError
from service.messages.status import SinkState
from service.sinks.bus import Bus
from service.sinks.recorder import RECORDER, recorder_of
from service.sinks.recording_order import RecordingOrder, Wish


def begin_recorder(bus: Bus, section: RecordingSection, wish: Wish | None) -> SinkState | None:
    """Have the recorder at work finish its file, and begin another; says how the former ended, if any was.

    Args:
        bus: of the service.
        section: where and how to record.
        wish: what to record; None = nothing until it is asked for.
    """
    try:
        ended = bus.remove(RECORDER)
    except SinkError:
        ended = None
    order = RecordingOrder(wish)
    bus.add(RECORDER, lambda: recorder_of(section, order), must_open=False)
    return ended
