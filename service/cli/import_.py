"""`lidarboost import`: camera files of other programs become a recording."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

_UNSAID = "What the files do not say"


def import_frames(
    frames: Annotated[
        list[Path],
        typer.Argument(metavar="FRAME...", help="Files of one camera; taken in natural order, 2 before 10."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write (MCAP).")],
    burst: Annotated[
        int | None, typer.Option(min=1, help="Frames per burst; without it all are one burst.")
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="The camera's calibration (TOML), instead of the files' own or its model's.",
            rich_help_panel=_UNSAID,
        ),
    ] = None,
    integration_time: Annotated[
        float | None,
        typer.Option(min=0.1, max=100, help="Per phase sample, ms.", rich_help_panel=_UNSAID),
    ] = None,
    frequency: Annotated[
        float | None,
        typer.Option(
            min=1, max=100, help="Modulation, MHz; SR4000: 30, SR3000: 20.", rich_help_panel=_UNSAID
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.01, max=1000, help="Frames per second, where no times are stored.", rich_help_panel=_UNSAID
        ),
    ] = None,
    amplitude: Annotated[
        Literal["linear", "gray"] | None,
        typer.Option(help="gray = the camera multiplied by distance².", rich_help_panel=_UNSAID),
    ] = None,
    inferred: Annotated[
        bool, typer.Option("--inferred", help="Accept formats of which a part is only inferred (.srs).")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say what was done as JSON.")] = False,
) -> None:
    """Make a recording of camera files.

    Reads SR4000 text frames (.dat, .txt) and binary ones (.bdat, .bin, with their timestamp.log) of various
    writers, and streams of the vendor's software (.srs). Distances become the radial counts that the camera
    measured, pixels without confidence become rejected ones. The camera's optics are fitted to the x, y, z of
    the files where they have them, else its model's; they go along, and it is said what was assumed.

    Try:  lidarboost import station/*.dat -o station.mcap

    then: lidarboost run --replay station.mcap --once --output out
    """
    from drivers.calibration import Calibration
    from drivers.importers import ImportOptions
    from drivers.importers import import_frames as start_import
    from service.cli import DATA_LOST
    from service.cli.counter import counted
    from service.errors import OutputError
    from service.jobs.importing import record_import

    if output.exists() and not force:
        raise OutputError(f"{output} exists already; choose another name, or replace it with --force")
    options = ImportOptions(
        integration_time=None if integration_time is None else integration_time / 1e3,
        modulation_frequency=None if frequency is None else frequency * 1e6,
        frame_rate=rate,
        amplitude_mode=amplitude,
        calibration=None if calibration is None else Calibration.load(calibration),
        accept_inferred=inferred,
    )
    found = start_import(frames, options, burst)
    with counted(found.count, "importing") as advance:
        done = record_import(found, output, burst, advance)
    for note in done.notes:
        print("note:", note, file=sys.stderr)
    for loss in done.lost:
        print("lost:", loss, file=sys.stderr)
    print(done.model_dump_json(indent=2) if as_json else done)
    if done.lost:
        raise typer.Exit(DATA_LOST)
