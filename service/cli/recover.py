"""`lidarboost recover`: a whole recording of what a torn or damaged one still holds."""

from pathlib import Path
from typing import Annotated

import typer


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A torn, damaged or `.active` recording.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Default: x.recovered.mcap beside it."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
) -> None:
    """Make a whole recording of what a torn or damaged one still holds, and say what is lost.

    The file itself is left as it is. The status is 3 where something is lost, 0 where all could be saved.
    """
    from drivers.recording import Recording, recover, recovered_path
    from service.cli import DATA_LOST
    from service.errors import OutputError

    target = output or recovered_path(file)
    if target.exists() and not force:
        raise OutputError(f"{target} exists already; choose another name, or replace it with --force")
    recording = Recording(file)
    messages = recover(recording, target)
    print(
        f"{target}: {recording.frame_count} frames, {messages} messages, {target.stat().st_size / 1e6:.2f} MB"
    )
    if recording.damage is None:
        print("nothing was missing")
        return
    print(f"lost: {recording.damage}")
    raise typer.Exit(DATA_LOST)
