"""`lidarboost watch`: what a running service says, as it says it."""

from typing import Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, connected


def watch(
    topic: Annotated[str, typer.Argument(metavar="[TOPIC]", help="A topic.")] = "fused/report",
    count: Annotated[int | None, typer.Option(min=1, help="End after so many messages.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON, one line a message.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
) -> None:
    """Print one line for each message of a topic, the latest first, until Ctrl-C."""
    from itertools import islice

    from service.jobs.saving import as_json as to_json
    from service.jobs.saving import summarize
    from service.streams import is_gone

    with connected(endpoint, prefix) as client, client.subscribe(topic) as messages:
        for received in islice(messages, count):
            print(
                to_json(received) if as_json else f"{_time(received.timestamp)} {summarize(received)}",
                flush=True,
            )
            if is_gone():
                return


def _time(timestamp: int | None) -> str:
    from datetime import UTC, datetime

    if timestamp is None:
        return "-"
    return f"{datetime.fromtimestamp(timestamp / 1e9, UTC):%H:%M:%S.%f}"[:-3]
