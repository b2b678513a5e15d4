"""What a session has declared, withdrawn without waiting for who does not read."""

import logging
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

import zenoh

from service.leaving import within

_PATIENCE = 0.3
"""Seconds; usually it takes less than one of their thousandths."""

_log = logging.getLogger(__name__)


class Declared(Protocol):
    """A publisher, a subscriber, a queryable or a token."""

    def undeclare(self) -> None: ...


def withdraw(declared: Sequence[Declared]) -> None:
    """Undeclare them, in order.

    Each tells every peer. While Zenoh gives one up that reads nothing that blocks for up to ten seconds: then
    they are left to the session's end.
    """

    def undeclare() -> None:
        for one in declared:
            with suppress(zenoh.ZError):  # the session has gone before
                one.undeclare()

    if not within(_PATIENCE, undeclare, "withdrawing"):
        _log.info("not all was withdrawn in %g s: a subscriber has stopped reading", _PATIENCE)
