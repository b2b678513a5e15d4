"""`lidarboost hz`: how fast and how evenly frames come."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def hz(
    config: Annotated[
        Path | None,
        typer.Option("--config", "-c", help="Configuration that names the camera; none = the first found."),
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.1, max=86400, help="How long to watch.")] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show a camera's true frame rate, its jitter, and the frames it drops.

    A line now and then while it watches, on standard error, and the sum at the end. Exit status 3: frames
    were dropped.

    [bold]Example[/bold]  lidarboost hz -c rig.toml --seconds 60
    """
    from service.capture.frame_rate import frame_rate, numbers_of
    from service.capture.live import filmed, live
    from service.config.file import load
    from service.errors import ServiceError

    seen: list[tuple[int, int, int]] = []
    with live(load(config)) as grabber:
        next_line = grabber.rig.clock.now() + 10**9
        for frame in filmed(grabber, seconds=seconds):
            seen.append(numbers_of(frame))
            if grabber.rig.clock.now() >= next_line and len(seen) > 2 and not as_json:
                print(f"{frame_rate(seen).rate:.2f} frames/s", file=sys.stderr)
                next_line += 10**9
    if not seen:
        raise ServiceError("no frame came: check the camera with lidarboost doctor")
    found = frame_rate(seen)
    print(found.model_dump_json(indent=2) if as_json else found)
    if found.dropped:
        raise typer.Exit(3)
