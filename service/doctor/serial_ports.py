"""The serial port of a stage."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from service.config.sections import Configuration
from service.doctor.check import Check
from service.doctor.processes import is_running, user_of


def check_serial(configuration: Configuration) -> Iterator[Check]:
    """Is the configured port there, and may this user open it? It is not opened: that resets some stages."""
    from drivers.listing import list_serial_ports
    from drivers.stages.serial_line import permission_remedy

    port = configuration.stage.options.get("port")
    if isinstance(port, str) and "://" not in port:
        yield _port(port)
    elif not port:
        found = list_serial_ports()
        denied = [device.where for device in found if device.permission == "denied"]
        said = f"{', '.join(denied)}: no permission" if denied else f"{len(found)} found, none configured"
        yield Check(
            name="serial port",
            state="warning" if denied else "ok",
            finding=said,
            remedy=permission_remedy(denied[0]) if denied else None,
        )
    if (port or list_serial_ports()) and is_running("ModemManager"):
        yield Check(
            name="serial port",
            state="warning",
            finding="ModemManager is running: it sends modem commands to new serial ports, stages among them",
            remedy="sudo systemctl disable --now ModemManager",
        )


def _port(port: str) -> Check:
    from drivers.stages.serial_line import permission_remedy

    path = Path(port)
    if not path.exists():
        return Check(
            name="serial port",
            state="problem",
            finding=f"{port} is not there",
            remedy="plug the stage in, and take its name from: ls -l /dev/serial/by-id",
        )
    if not os.access(path, os.R_OK | os.W_OK):
        return Check(
            name="serial port",
            state="problem",
            finding=f"{port}: no permission",
            remedy=permission_remedy(port),
        )
    user = user_of(path)
    if user is not None:
        return Check(
            name="serial port",
            state="warning",
            finding=f"{port} is in use by {user}",
            remedy=f"stop it, unless it is the service itself: fuser -v {port}",
        )
    return Check(name="serial port", state="ok", finding=port)
