"""`lidarboost export`: frames and fused maps as NumPy arrays or point clouds."""

import sys
from collections import deque
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer


def export(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A recording (MCAP), of frames or of fused maps.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help=".npz: arrays; .ply: a point cloud.")
    ],
    number: Annotated[
        int | None,
        typer.Option(min=0, help="Which map or frame, from 0.", show_default=".npz: every; .ply: 0"),
    ] = None,
    latest: Annotated[bool, typer.Option("--latest", help="The last map or frame.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help="Every map or frame: OUT-0000.ply, OUT-0001.ply, ….")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
) -> None:
    """Export frames and fused maps to NumPy or PLY.

    .npz holds everything, or the one map or frame that is named: frames as counts, amplitude, distance,
    timestamp, pan, tilt and settings; fused maps as fused_depth, fused_deviation, fused_amplitude,
    fused_reason; intrinsics of both. .ply is a cloud in camera axes (x right, y down, z forward, metres).
    What is named is a fused map where the recording holds some, else a frame.

    Try:  lidarboost export out/fused.mcap -o map.ply
    """
    from drivers.recording import Recording
    from service.cli import DATA_LOST
    from service.errors import ConfigurationError, OutputError
    from service.jobs.export import clouds, export_arrays, export_cloud, none_of

    if every + latest + (number is not None) > 1:
        raise typer.BadParameter("--number, --latest and --all exclude each other: give one of them")
    if output.suffix not in (".npz", ".ply"):
        raise ConfigurationError(f"--output: {output} is of no kind known here; expected .npz or .ply")
    if output.exists() and not (force or every):
        raise OutputError(f"{output} exists already; choose another name, or replace it with --force")
    recording = Recording(file)
    if output.suffix == ".npz":
        which = slice(-1, None) if latest else None if number is None else slice(number, number + 1)
        print(f"{output}: {export_arrays(recording, output, which)}")
    else:
        first = number or 0
        found = enumerate(clouds(recording))
        chosen = found if every else deque(found, 1) if latest else islice(found, first, first + 1)
        written = 0
        for index, points in chosen:
            path = output.with_name(f"{output.stem}-{index:04d}{output.suffix}") if every else output
            if path.exists() and not force:
                raise OutputError(f"{path} exists already; choose another name, or replace it with --force")
            print(f"{path}: {export_cloud(points, path)}")
            written += 1
        if not written:
            raise none_of(recording, first)
    if recording.damage is not None:
        print(f"lost: {recording.damage}", file=sys.stderr)
        raise typer.Exit(DATA_LOST)
