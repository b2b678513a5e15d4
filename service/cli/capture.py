"""`lidarboost capture`: a few frames for a quick look."""

from pathlib import Path
from typing import Annotated

import typer


def capture(
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write (MCAP).")],
    frames: Annotated[int, typer.Option("--frames", "-n", min=1, max=100_000, help="How many.")] = 10,
    config: Annotated[
        Path | None,
        typer.Option("--config", "-c", help="Configuration that names the camera; none = the first found."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say what was done as JSON.")] = False,
) -> None:
    """Record a few frames as they are, without moving the stage, and draw them (FILE.png).

    [bold]Examples[/bold]

      lidarboost capture -n 10 -o look.mcap

      lidarboost capture -n 50 -o wall-2m.mcap -c rig.toml      (for lidarboost calibrate)
    """
    import json

    import numpy as np

    from service.capture.live import filmed, live
    from service.config.file import load
    from service.errors import OutputError
    from service.jobs.quick_look import draw_frames, record_frames

    if output.exists() and not force:
        raise OutputError(f"{output} exists already; choose another name, or replace it with --force")
    configuration = load(config)
    with live(configuration) as grabber:
        kept = record_frames(output, filmed(grabber, frames), grabber.rig, configuration)
        dropped, model = grabber.counts.dropped, grabber.rig.camera.capabilities.model
    picture = output.with_suffix(".png")
    draw_frames(picture, kept)
    valid = float(np.mean([frame.valid.mean() for frame in kept]))
    said = {
        "recording": str(output),
        "picture": str(picture),
        "camera": model,
        "frames": len(kept),
        "dropped": dropped,
        "valid": valid,
        "median_distance": float(np.nanmedian(kept[0].distance)) if kept[0].valid.any() else None,
    }
    if as_json:
        print(json.dumps(said, indent=2))
    else:
        print(
            f"{len(kept)} frames of {model}, {dropped} dropped, {100 * valid:.1f} % of the pixels valid\n"
            f"wrote {output} and {picture}"
        )
