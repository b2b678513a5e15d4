"""Keeps what is to be said of each map, and says it in the log."""

import logging
import time
from collections import deque
from collections.abc import Callable

from service.messages.events import Event, MapFused
from service.messages.summary import BurstSummary, describe, summary_of
from service.sinks.sink import Sink

_REMEMBERED = 1000
"""Maps of which a run keeps the summary: the service runs for weeks."""

_BETWEEN = 1.0
"""Seconds from one line in the log to the next: a stream gives tens of maps a second, for weeks."""

_log = logging.getLogger(__name__)


class Summaries(Sink):
    """The last thousand maps, with their errors where there is a truth; the log gets one a second at most.

    Args:
        kept: where they go.
        clock: seconds.
    """

    wants = (MapFused,)
    droppable = (MapFused,)

    def __init__(
        self, kept: "deque[BurstSummary] | None" = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__()
        self._clock, self._said = clock, -_BETWEEN
        self.kept = deque(maxlen=_REMEMBERED) if kept is None else kept

    def take(self, event: Event) -> None:
        assert isinstance(event, MapFused)
        burst = summary_of(event)
        self.kept.append(burst)
        now = self._clock()
        if now - self._said >= _BETWEEN:
            self._said = now
            _log.info("%s", describe(burst))
