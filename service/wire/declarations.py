"""What a session has declared: how it goes without anybody waiting for a subscriber that does not read.

Undeclaring tells every peer. While Zenoh gives one up that has stopped reading that takes up to ten seconds.
"""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Protocol

import zenoh

from service.leaving import within

_PATIENCE = 0.3
"""Seconds; usually it takes less than one of their thousandths."""

_publishers: dict[str, dict[str, Any]] = {}
"""By session and key."""

_log = logging.getLogger(__name__)


class Declared(Protocol):
    """A subscriber, a queryable or a token."""

    def undeclare(self) -> None: ...


def lasting_publisher(session: zenoh.Session, key: str, declare: Callable[[], Any]) -> Any:
    """The publisher of a key, declared at its first use, which lasts as long as its session.

    Undeclaring or dropping an advanced one blocks with the interpreter's lock held: all threads stand still.
    """
    of_session = _publishers.setdefault(str(session.info.zid()), {})
    if key not in of_session:
        of_session[key] = declare()
    return of_session[key]


def drop_publishers(zid: str) -> None:
    """Those of a session that is closed: there is nobody left to tell."""
    _publishers.pop(zid, None)


def withdraw(declared: Sequence[Declared]) -> None:
    """Undeclare them, in order; what is not done in time is left to the session's end."""

    def undeclare() -> None:
        for one in declared:
            with suppress(zenoh.ZError):  # the session has gone before
                one.undeclare()

    if not within(_PATIENCE, undeclare, "withdrawing"):
        _log.info("not all was withdrawn in %g s: a subscriber has stopped reading", _PATIENCE)
