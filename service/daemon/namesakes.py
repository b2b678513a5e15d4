"""Tells while another service answers under the same name, and both are mixed up at who listens."""

import logging
import time
from collections.abc import Callable

import zenoh

from service.daemon.states import States

_PART = "name"
_REMEDY = "give one of them another zenoh.prefix, and start it again"

_EVERY = 5.0
"""Seconds from question to question; an answer that takes longer counts with the next."""

_log = logging.getLogger(__name__)


class Namesakes:
    """Asks for its own status, which one service alone should answer.

    Args:
        session: the service's.
        prefix: what its keys begin with.
        states: told of others.
        clock: seconds.
    """

    def __init__(
        self,
        session: zenoh.Session,
        prefix: str,
        states: States,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._prefix, self._states, self._clock = session, prefix, states, clock
        self._own = str(session.zid())
        self._answered: set[str] = set()
        self._known: frozenset[str] = frozenset()
        self._next = clock()

    def look(self) -> None:
        """Judge by who has answered since the last question, and ask anew; at once, whoever answers."""
        if self._clock() < self._next:
            return
        self._next = self._clock() + _EVERY
        self._judge(frozenset(self._answered - {self._own}))
        answered: set[str] = set()
        self._answered = answered
        self._session.get(
            f"{self._prefix}/status",
            lambda reply: _note(reply, answered),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_EVERY,
        )

    def _judge(self, others: frozenset[str]) -> None:
        if others:
            count = f"{len(others)} more on this network called {self._prefix}"
            what = f"{count}: they are mixed up at who listens"
            self._states.degrade(_PART, what, _REMEDY)
            if not self._known:
                _log.warning("%s; %s", what, _REMEDY)
        else:
            self._states.mend(_PART)
        self._known = others


def _note(reply: zenoh.Reply, answered: set[str]) -> None:
    if reply.ok is not None and reply.replier_id is not None:
        answered.add(str(reply.replier_id.zid))
