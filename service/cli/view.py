"""`lidarboost view`: a recording or a running rig in Rerun."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout


def view(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A recording, MCAP; none = a running rig.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Show nothing, but save what would be shown as PNG; of a rig its latest map."),
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 10.0,
) -> None:
    """Show a recording or a running rig in the viewer Rerun, until it is closed.

    Needs lidarboost[rerun]. The viewer listens on loopback alone.

    [bold]Examples[/bold]

      lidarboost view out/fused.mcap

      lidarboost view --endpoint tcp/127.0.0.1:7447

      lidarboost view out/fused.mcap --picture map.png
    """
    from service.jobs.rerun_view import show_live, viewer

    if file is not None:
        from drivers.recording import Recording

        Recording(file)  # what is none is told here, in one line
    with viewer(headless=picture is not None) as shown:
        if file is not None:
            shown.show(file)
        else:
            show_live(shown, endpoint, prefix, timeout, maps=None if picture is None else 1)
        if picture is not None:
            shown.save_picture(picture)
            print(f"wrote {picture}")
        elif file is not None:
            shown.wait()
