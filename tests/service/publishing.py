"""A publisher by itself."""

from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from service.sinks.publisher import Publisher


@contextmanager
def publishing(session: zenoh.Session, *, lossless: bool = False) -> Iterator[Publisher]:
    """One that is open, and closed in the end."""
    publisher = Publisher(session, lossless=lossless)
    publisher.open()
    try:
        yield publisher
    finally:
        publisher.close()
