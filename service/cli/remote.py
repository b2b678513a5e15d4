"""Options of the commands that talk to a running service."""

from typing import Annotated

import typer

from service.wire.addresses import DEFAULT_ENDPOINT, DEFAULT_PREFIX

Endpoint = Annotated[
    str, typer.Option(envvar="LIDARBOOST_ENDPOINT", help="Where the service, or a router, listens.")
]
Prefix = Annotated[str, typer.Option(envvar="LIDARBOOST_ZENOH__PREFIX", help="What its keys begin with.")]
Timeout = Annotated[float, typer.Option(min=0.1, max=3600, help="Seconds to wait for an answer.")]

__all__ = ["DEFAULT_ENDPOINT", "DEFAULT_PREFIX", "Endpoint", "Prefix", "Timeout"]
