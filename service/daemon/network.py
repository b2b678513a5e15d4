"""Tells while the routers that the service shall be connected to are not."""

import logging
import time
from collections.abc import Callable

from service.daemon.states import States
from service.wire.links import Links

_PART = "network"
_REMEDY = "it connects again by itself: start what listens there, or look at the way to it"

_log = logging.getLogger(__name__)


class Network:
    """Looks after the connections of a session, once a second.

    Args:
        links: what is configured, and what is there.
        states: told what is missing.
        clock: seconds.
    """

    def __init__(self, links: Links, states: States, clock: Callable[[], float] = time.monotonic) -> None:
        self._links, self._states, self._clock = links, states, clock
        self._at_other_end: dict[str, str] = {}
        self._missing: dict[str, float] = {}

    def look(self) -> None:
        """See what has come and gone since the last time."""
        if not self._links.wanted:
            return
        connected = self._links.connected()
        for wanted in self._links.wanted:
            self._judge(wanted, connected.get(wanted))
        if self._missing:
            self._states.degrade(_PART, f"not connected to {', '.join(self._missing)}", _REMEDY)
        else:
            self._states.mend(_PART)

    def _judge(self, address: str, at_other_end: str | None) -> None:
        before = self._at_other_end.get(address)
        if at_other_end is None:
            if address not in self._missing:
                self._missing[address] = self._clock()
                lost = "is lost" if before else "is not there yet"
                _log.warning("the connection to %s %s; nobody beyond it is served meanwhile", address, lost)
            return
        since = self._missing.pop(address, None)
        if since is not None:
            _log.info("connected to %s after %.0f s", address, self._clock() - since)
        elif before and before != at_other_end:
            _log.warning("%s was started again; those beyond it connect anew", address)
        self._at_other_end[address] = at_other_end
