"""`lidarboost stage`: what turns the camera of a running service."""

from math import degrees
from typing import TYPE_CHECKING

import typer

from service.cli.commanding import add_verb

if TYPE_CHECKING:
    from service.wire.asking import Answer

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Ask, stop or home the stage of a running service."
)


def _where(answer: "Answer") -> str:
    if answer["pan"] is None:
        return f"position unknown: {answer['uncertainty']}; `lidarboost stage home` {answer['homing']}"
    lines = []
    for axis in ("pan", "tilt"):
        low, high = (degrees(angle) for angle in answer[f"{axis}_limits"])
        lines.append(f"{axis} {degrees(answer[axis]):.3f}°, limits {low:.3f}° to {high:.3f}°")
    return "\n".join(lines)


add_verb(app, "cmd/stage", "get", "Where it reports to be, and its limits.", 30.0, _where)
add_verb(app, "cmd/stage", "stop", "Halt at once, whatever it does; a scan is cancelled.", 30.0, _where)
add_verb(
    app,
    "cmd/stage",
    "home",
    "Find its reference position, then go to 0°, 0°. This is consent: nobody may be in its way.",
    180.0,
    _where,
)
