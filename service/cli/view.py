"""`lidarboost view`: a rig in a browser."""

from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix

if TYPE_CHECKING:
    from service.web.options import PageOptions


def view(
    web: Annotated[bool, typer.Option("--web", help="As a page in a browser.")] = False,
    host: Annotated[
        str,
        typer.Option(
            envvar="LIDARBOOST_WEB__HOST", help="Address to listen on; others than loopback need a token."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            envvar="LIDARBOOST_WEB__PORT", min=0, max=65535, help="Port to listen on; 0 = any that is free."
        ),
    ] = 8470,
    token: Annotated[
        str | None,
        typer.Option(envvar="LIDARBOOST_WEB__TOKEN", help="What whoever opens the page has to know."),
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
) -> None:
    """Serve the live page of a rig, here or anywhere on the network, until Ctrl-C.

    The rig need not run yet; it may be restarted meanwhile.

    [bold]Examples[/bold]

      lidarboost view --web

    The page of another machine's rig:
      lidarboost view --web --endpoint tcp/192.168.1.20:7447

    For a tablet in the same network; give the token as LIDARBOOST_WEB__TOKEN, which other users do not see:
      LIDARBOOST_WEB__TOKEN=… lidarboost view --web --host 0.0.0.0
    """
    from urllib.parse import quote

    from service.signals import stopping
    from service.versions import PAGE_PACKAGES, require_packages

    if not web:
        raise typer.BadParameter("say how: --web serves a page for a browser")
    require_packages("web", *PAGE_PACKAGES)
    from service.web.server import PageServer

    options = _options({"host": host, "port": port, "token": token, "endpoint": endpoint, "prefix": prefix})
    with stopping() as signals, PageServer(options) as page:
        signals.stops(page.stop)
        secret = "" if options.secret is None else f"?token={quote(options.secret, safe='')}"
        print(f"page: {page.url}{secret}", flush=True)
        while not page.wait(1.0):
            pass


def _options(given: dict[str, object]) -> "PageOptions":
    from pydantic import ValidationError

    from service.errors import ConfigurationError
    from service.web.options import PageOptions

    try:
        return PageOptions.model_validate(given)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False)
        said = "; ".join(
            f"--{fault['loc'][0]}: {fault['msg']}" if fault["loc"] else fault["msg"] for fault in faults
        )
        raise ConfigurationError(said.replace("web.token", "--token")) from error
