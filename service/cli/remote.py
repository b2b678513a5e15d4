"""Options of the commands that talk to a running service."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from service.wire.addresses import DEFAULT_ENDPOINT, DEFAULT_PREFIX

if TYPE_CHECKING:
    from service.wire.client import Client

Endpoint = Annotated[
    str,
    typer.Option(
        envvar="LIDARBOOST_ENDPOINT",
        help="Where the service, or a router, listens; LIDARBOOST_CLIENT = a Zenoh file with certificates.",
    ),
]
Prefix = Annotated[str, typer.Option(envvar="LIDARBOOST_ZENOH__PREFIX", help="What its keys begin with.")]
Timeout = Annotated[float, typer.Option(min=0.1, max=3600, help="Seconds to wait for an answer.")]


@contextmanager
def connected(endpoint: str, prefix: str) -> "Iterator[Client]":
    """A client, closed in the end."""
    from service.wire.client import Client

    with Client(endpoint, prefix, config=os.environ.get("LIDARBOOST_CLIENT") or None) as client:
        yield client


__all__ = ["DEFAULT_ENDPOINT", "DEFAULT_PREFIX", "Endpoint", "Prefix", "Timeout", "connected"]
