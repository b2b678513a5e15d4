"""Hears what a pan-tilt unit says: answers as they are awaited, events whenever they come."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.clock import Clock
from drivers.errors import LimitError
from drivers.stages.ptu_replies import VERSION, Replies, Reply, answers
from drivers.stages.serial_line import SerialLine

QUIET_SECONDS = 0.1
"""Silence after which a unit has said all that it had to say."""

EVENTS = {
    "P": "the pan axis hit a limit",
    "T": "the tilt axis hit a limit",
    "D": "the head's cable came off",
}

_log = logging.getLogger(__name__)


class PtuEar:
    """Replies of one unit; an event raises `LimitError`, except where it is expected.

    Attributes:
        strays: answers that belonged to nothing just asked.
    """

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line, self._clock = line, clock
        self._replies = Replies()
        self._expected: list[str] | None = None
        self.strays = 0

    def next_reply(self, query: bool, deadline: int) -> Reply | None:
        """The next answer or refusal before `deadline` (ns); `query` as in `Replies.take`."""
        while True:
            remaining = max(0.0, (deadline - self._clock.now()) / 1e9)
            data = self._line.receive(min(QUIET_SECONDS, remaining))
            self._replies.feed(data)
            while (reply := self._replies.take(query, final=not data)) is not None:
                if reply.kind != "event":
                    return reply
                self._event(reply)
            if not data and self._clock.now() >= deadline:
                return None

    def absorb(self) -> None:
        """Take what was said unasked: events raise, all else belongs to nothing."""
        self._replies.feed(self._line.pending())
        while (reply := self._replies.take(query=False, final=True)) is not None:
            if reply.kind == "event":
                self._event(reply)
            else:
                self.stray(reply)
        self._replies.clear()

    def settle(self) -> None:
        """As `absorb`, once the unit has fallen silent."""
        self._replies.feed(self._line.discard(QUIET_SECONDS))
        self.absorb()

    def stray(self, reply: Reply) -> None:
        """Count an answer to nothing; one to `V` cannot be taken for any other, and does no harm."""
        if not answers(VERSION, reply.text):
            self.strays += 1
            _log.debug("%s: not what was asked for: %s %r", self._line.name, reply.kind, reply.text)

    @contextmanager
    def expecting_events(self) -> Iterator[list[str]]:
        """Gather events instead of raising them."""
        before, self._expected = self._expected, []
        try:
            yield self._expected
        finally:
            self._expected = before

    def _event(self, reply: Reply) -> None:
        if self._expected is None:
            raise LimitError(f"{self._line.name}: {EVENTS[reply.text]}; steps are lost: home it")
        self._expected.append(reply.text)
