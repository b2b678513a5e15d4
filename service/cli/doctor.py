"""`lidarboost doctor`: what stands in the way of a rig on this machine, and how to mend it."""

from pathlib import Path
from typing import Annotated

import typer

MARKS = {"ok": "ok     ", "warning": "warning", "problem": "PROBLEM"}


def doctor(
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Configuration of the rig to check for.")
    ] = None,
    rules: Annotated[
        bool, typer.Option("--udev-rules", help="Print the udev rules for all known cameras, and end.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Check what a rig needs: USB, libraries, ports, kernels, disk, clock, and who it works with.

    USB permission, udev rule, vendor library, serial port, Zenoh, ROS 2, kernels, cluster, disk, clock.
    No device is opened, nothing is sent or changed. Under each problem stands the line that mends it.

    [bold]Exit status[/bold]  0 nothing stands in the way (warnings aside); 1 there is a problem
    """
    import json

    from service.config.file import load
    from service.doctor import examine, udev_rules

    if rules:
        print(udev_rules(), end="")
        return
    checks = examine(load(config))
    if as_json:
        print(json.dumps([check.model_dump() for check in checks], indent=2))
    else:
        for check in checks:
            print(f"{MARKS[check.state]}  {check.name}: {check.finding}")
            if check.remedy is not None:
                print(f"         → {check.remedy}")
    if any(check.state == "problem" for check in checks):
        raise typer.Exit(1)
