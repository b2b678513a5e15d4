"""Keeps what is to be said of each map, and says it in the log."""

import logging
from collections import deque

from service.messages.events import Event, MapFused
from service.messages.summary import BurstSummary, describe, summary_of
from service.sinks.sink import Sink

_REMEMBERED = 1000
"""Maps of which a run keeps the summary: the service runs for weeks."""

_log = logging.getLogger(__name__)


class Summaries(Sink):
    """The last thousand maps, with their errors where there is a truth."""

    wants = (MapFused,)
    droppable = (MapFused,)

    def __init__(self, kept: "deque[BurstSummary] | None" = None) -> None:
        super().__init__()
        self.kept = deque(maxlen=_REMEMBERED) if kept is None else kept

    def take(self, event: Event) -> None:
        assert isinstance(event, MapFused)
        burst = summary_of(event)
        self.kept.append(burst)
        _log.info("%s", describe(burst))
