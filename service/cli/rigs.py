"""`lidarboost rigs`: which rigs are alive."""

import json
import sys
from typing import Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, Timeout


def rigs(
    endpoints: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ENDPOINT...]",
            envvar="LIDARBOOST_ENDPOINT",
            help="Where services, or routers, listen.",
            show_default=DEFAULT_ENDPOINT,
        ),
    ] = None,
    timeout: Timeout = 2.0,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON, with the warnings.")] = False,
) -> None:
    """List the rigs that answer at the endpoints given, with what each is doing; nothing else is searched.

    Warns of two with one name, and of cameras that run at the same time
    with the same modulation frequency.

    [bold]Example[/bold]  lidarboost rigs tcp/10.0.0.7:7447 tcp/10.0.0.8:7447

    [bold]Exit status[/bold]  0 all endpoints answered; 1 one did not
    """
    from service.jobs.rigs import rigs_at, warnings_about

    found, silent = rigs_at(endpoints or [DEFAULT_ENDPOINT], timeout)
    warnings = warnings_about(found)
    if as_json:
        said = {"rigs": [rig.as_json() for rig in found], "silent": silent, "warnings": warnings}
        print(json.dumps(said, indent=2))
    for rig in [] if as_json else found:
        camera = f"{rig.source}: {rig.model}" if rig.source else "no camera"
        light = f", {rig.modulation_frequency / 1e6:g} MHz" if rig.modulation_frequency else ""
        print(f"{rig.prefix:<20} {rig.endpoint:<24} {rig.state}: {rig.reason}; {camera}{light}")
        for fault in rig.degraded:
            print(f"{'':<20} degraded: {fault}")
    for warning in warnings:
        print("warning:", warning, file=sys.stderr)
    for endpoint in silent:
        print(f"error: no service answered at {endpoint} within {timeout:g} s", file=sys.stderr)
    if silent:
        raise typer.Exit(1)
