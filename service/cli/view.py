"""`lidarboost view`: a recording or a running rig in Rerun, or a rig in a browser."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout

_PAGE = "The live page"


def view(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A recording, MCAP; none = a running rig.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Show nothing, but save what would be shown as PNG; of a rig its latest map."),
    ] = None,
    web: Annotated[
        bool, typer.Option("--web", help="Serve the live page of a rig instead.", rich_help_panel=_PAGE)
    ] = False,
    host: Annotated[
        str,
        typer.Option(
            envvar="LIDARBOOST_WEB__HOST",
            help="Address to listen on; one that others can reach needs a token.",
            rich_help_panel=_PAGE,
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            envvar="LIDARBOOST_WEB__PORT",
            min=0,
            max=65535,
            help="Port to listen on; 0 = any that is free.",
            rich_help_panel=_PAGE,
        ),
    ] = 8470,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="LIDARBOOST_WEB__TOKEN",
            help="What whoever opens the page has to know.",
            rich_help_panel=_PAGE,
        ),
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 10.0,
) -> None:
    """Show a recording or a running rig in the viewer Rerun, until it is closed.

    Needs lidarboost[rerun]. The viewer listens on loopback alone.

    With --web it serves the live page of a rig, here or anywhere on the
    network, until Ctrl-C; needs lidarboost[web]. The rig need not run yet.

    [bold]Examples[/bold]

      lidarboost view out/fused.mcap

      lidarboost view --endpoint tcp/127.0.0.1:7447

      lidarboost view out/fused.mcap --picture map.png

    The live page, of a rig on another machine:
      lidarboost view --web --endpoint tcp/192.168.1.20:7447

    For a tablet in the same network, with a token that other users do not see:
      LIDARBOOST_WEB__TOKEN=… lidarboost view --web --host 0.0.0.0
    """
    if web:
        from service.cli.page import serve_page

        if file is not None or picture is not None:
            raise typer.BadParameter("--web shows a running rig; load a recording on its page")
        serve_page(host=host, port=port, token=token, endpoint=endpoint, prefix=prefix)
        return
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
