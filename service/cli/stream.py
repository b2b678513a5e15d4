"""`lidarboost stream`: a map for every frame of a running service."""

from typing import Annotated

import typer

from service.cli.commanding import AsJson, add_verb, say
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Have a running service give a map for every frame.",
)

add_verb(app, "cmd/stream", "stop", "End after the frame at work.")


@app.command()
def start(
    window: Annotated[
        int | None, typer.Option(min=1, max=200, help="Frames that are fused together.")
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 60.0,
    as_json: AsJson = False,
) -> None:
    """Stream; a scan at work ends after its burst."""
    with connected(endpoint, prefix) as rig:
        say(rig.stream.start(window, timeout), as_json)
