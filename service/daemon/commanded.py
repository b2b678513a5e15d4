"""A daemon that can be asked for things over Zenoh."""

from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from drivers.text import json_of
from service.daemon.commands import commands
from service.daemon.daemon import Daemon
from service.daemon.desk import Desk
from service.daemon.dispatcher import Dispatcher
from service.daemon.manifest import manifest_of, schemas
from service.wire.answers import Answers
from service.wire.queries import Queries


@contextmanager
def commanded(daemon: Daemon, session: zenoh.Session) -> Iterator[None]:
    """It answers its commands, its manifest and its schemas meanwhile."""
    table, prefix = commands(), daemon.configuration.zenoh.prefix
    dispatcher = Dispatcher(Desk(daemon), table)
    daemon.command_counts = lambda: dispatcher.counts

    def manifest() -> bytes:
        return json_of(manifest_of(daemon, table))

    with (
        Answers(session, prefix, manifest, lambda: schemas(table)),
        Queries(session, prefix, table, dispatcher.handle, dispatcher.refused),
    ):
        yield
