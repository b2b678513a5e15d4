"""`lidarboost import`: camera files of other programs become a recording."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from drivers.depth.reading import DepthReading, Kind

_UNSAID = "What the files do not say"
_DEPTH = "Depth images of other cameras"


def import_frames(
    frames: Annotated[
        list[Path],
        typer.Argument(
            metavar="FRAME...", help="Files of one camera, or their folder; in natural order, 2 before 10."
        ),
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
    kind: Annotated[
        Literal["depth", "distance"] | None,
        typer.Option(
            help="depth = Z, along the optical axis (REP 118); distance = along each pixel's ray.",
            rich_help_panel=_DEPTH,
        ),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Metres per unit; bags: 0.001 for integers, else 1.", rich_help_panel=_DEPTH),
    ] = None,
    invalid: Annotated[
        list[float] | None,
        typer.Option(help="A value that means no depth, besides 0, NaN, 65535.", rich_help_panel=_DEPTH),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(help="The depth images, where a bag has several.", rich_help_panel=_DEPTH)
    ] = None,
    amplitude_from: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC|FOLDER", help="Images of the received light, if any.", rich_help_panel=_DEPTH
        ),
    ] = None,
    camera_info: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="The optics, where they lie elsewhere.", rich_help_panel=_DEPTH),
    ] = None,
    rectified: Annotated[
        bool | None,
        typer.Option(
            "--rectified/--distorted",
            help="Whether the lens distortion was taken out; told by the topic's name otherwise.",
            rich_help_panel=_DEPTH,
        ),
    ] = None,
    inferred: Annotated[
        bool, typer.Option("--inferred", help="Accept formats of which a part is only inferred (.srs).")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say what was done as JSON.")] = False,
) -> None:
    """Make a recording of camera files, of SwissRangers and of others.

    Reads SR4000 text frames (.dat, .txt) and binary ones (.bdat, .bin, with their timestamp.log) of various
    writers, and streams of the vendor's software (.srs). Distances become the radial counts that the camera
    measured, pixels without confidence become rejected ones. The camera's optics are fitted to the x, y, z of
    the files where they have them, else its model's; they go along, and it is said what was assumed.

    Of other depth cameras: bags of ROS 2 (.mcap, .db3, or their folder) and ROS 1 (.bag), Foxglove's messages
    in .mcap, and folders of .png, .tif, .exr or .npy with a --calibration file.

    Try:  lidarboost import station/*.dat -o station.mcap

          lidarboost import bag/ --kind depth --burst 15 -o bag.mcap

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
        reading=_reading(kind, scale, invalid or ()),
        topic=topic,
        amplitude=amplitude_from,
        camera_info=camera_info,
        rectified=rectified,
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


def _reading(kind: "Kind | None", scale: float | None, invalid: Sequence[float]) -> "DepthReading":
    """How depth images are read; values out of bounds are wrong usage."""
    from pydantic import ValidationError

    from drivers.depth.reading import DepthReading
    from drivers.documents import told

    try:
        return DepthReading(kind=kind, scale=scale, invalid=tuple(invalid))
    except ValidationError as error:
        raise typer.BadParameter(told(error)) from error
