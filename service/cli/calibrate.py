"""`lidarboost calibrate`: finds a camera's optics, errors, noise and mount, and saves them as TOML."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.cli.calibrating import base_of, board_of, check_output, configured, counted, footage_of, save

calibrate = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Find a camera's optics, errors, noise and mount.",
    rich_markup_mode="rich",
    epilog="Each writes a calibration file (name it in camera.calibration) and a picture beside it. Begin "
    "with intrinsics, and give the file of each step to the next one by --base.",
)

Recordings = Annotated[
    list[Path] | None, typer.Argument(help="Recordings to use; none = the camera of --config.")
]
Config = Annotated[
    Path | None, typer.Option("--config", "-c", help="Configuration that names the camera and stage.")
]
Output = Annotated[Path, typer.Option("--output", "-o", help="The calibration file to write.")]
Base = Annotated[
    Path | None, typer.Option(help="Calibration to start from; none = the recording's, or the camera's.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that exists.")]
Json = Annotated[bool, typer.Option("--json", help="Print the calibration and the summary as JSON.")]
Corners = Annotated[str, typer.Option("--board", help="Inner corners of the board: columns x rows.")]
Square = Annotated[float, typer.Option(min=1, max=1000, help="Side of a field, mm.")]
Charuco = Annotated[
    str | None, typer.Option(help="Marker dictionary of a ChArUco board, such as DICT_4X4_50.")
]
Marker = Annotated[float, typer.Option(min=0, max=1000, help="Side of a ChArUco marker, mm.")]
Frames = Annotated[
    int, typer.Option("--frames", "-n", min=2, max=10_000, help="Frames to take from a live camera.")
]

DEFAULT_OUTPUT = Path("calibration.toml")


@calibrate.command()
def intrinsics(
    recordings: Recordings = None,
    config: Config = None,
    board: Corners = "9x6",
    square: Square = 50.0,
    charuco: Charuco = None,
    marker: Marker = 0.0,
    views: Annotated[int, typer.Option(min=8, max=200, help="Different views that are enough.")] = 20,
    seconds: Annotated[
        float, typer.Option(min=1, max=3600, help="How long to watch a live camera, at most.")
    ] = 180.0,
    output: Output = DEFAULT_OUTPUT,
    base: Base = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Focal length, principal point and distortion, from views of a chessboard or ChArUco board.

    Show the board in all parts of the image, near, and tilted by 30° left, right, up and down.

    [bold]Examples[/bold]

      lidarboost calibrate intrinsics board.mcap --board 9x6 --square 50

      lidarboost calibrate intrinsics -c rig.toml --board 8x5 --square 40 --charuco DICT_4X4_50 --marker 30
    """
    from service.calibration.footage import find_sightings, recorded
    from service.calibration.intrinsics import calibrate_intrinsics
    from service.capture.live import filmed, live

    check_output(output, base, force)
    printed = board_of(board, square, charuco, marker)
    with counted() as tell:
        if recordings:
            footage = recorded(recordings)
            frames = [frame for part in footage for frame in part.frames]
            known = footage[0].calibration
            seen = find_sightings(frames, printed, views, tell)
        else:
            with live(configured(config)) as grabber:
                known = grabber.rig.calibration
                seen = find_sightings(filmed(grabber, seconds=seconds), printed, views, tell)
    fit = calibrate_intrinsics(seen, known.shape)
    save(fit, "intrinsics", base_of(base, known), output, as_json)


@calibrate.command()
def distance(
    recordings: Recordings = None,
    config: Config = None,
    at: Annotated[
        list[float] | None,
        typer.Option(
            help="Perpendicular distance of each wall from the camera, metres, one per recording, in their "
            "order; without, the constant is found from the wall's flatness, far less well."
        ),
    ] = None,
    harmonics: Annotated[
        list[int] | None,
        typer.Option(min=1, max=16, help="Harmonics of the cyclic error; four samples give the fourth."),
    ] = None,
    per_pixel: Annotated[bool, typer.Option(help="Fit a pattern of the pixels.")] = True,
    frames: Frames = 20,
    output: Output = DEFAULT_OUTPUT,
    base: Base = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Constant, cyclic and pixel errors of the distance, from frames of flat walls.

    One recording for each distance, the wall filling the view. Let the camera warm up for half an hour first.

    [bold]Example[/bold]

      lidarboost capture -n 20 -o wall-1.mcap -c rig.toml     (and so on, at other distances)

      lidarboost calibrate distance wall-1.mcap wall-2.mcap wall-3.mcap --at 1.0 --at 2.0 --at 3.0
    """
    from service.calibration.distance import calibrate_distance

    check_output(output, base, force)
    footage = footage_of(recordings, config, frames)
    known = base_of(base, footage[0].calibration)
    fit = calibrate_distance(
        [part.frames for part in footage], known, at or None, tuple(harmonics or (4,)), per_pixel
    )
    save(fit, "distance", known, output, as_json)


@calibrate.command()
def noise(
    recordings: Recordings = None,
    config: Config = None,
    frames: Frames = 20,
    output: Output = DEFAULT_OUTPUT,
    base: Base = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """How the noise of the distance depends on the amplitude, from frames of still scenes.

    One recording for each scene, with bright and dark things in view; nothing may move in it.

    [bold]Examples[/bold]

      lidarboost calibrate noise still.mcap

      lidarboost calibrate noise -c rig.toml -n 50 --base calibration.toml -o calibration.toml
    """
    from service.calibration.noise import calibrate_noise

    check_output(output, base, force)
    footage = footage_of(recordings, config, frames)
    fit = calibrate_noise([part.frames for part in footage])
    save(fit, "noise", base_of(base, footage[0].calibration), output, as_json)


@calibrate.command()
def mount(
    recordings: Recordings = None,
    config: Config = None,
    board: Corners = "9x6",
    square: Square = 50.0,
    charuco: Charuco = None,
    marker: Marker = 0.0,
    pan: Annotated[
        float, typer.Option(min=0, max=60, help="How far to turn to either side, degrees (live).")
    ] = 8.0,
    tilt: Annotated[
        float, typer.Option(min=0, max=40, help="How far to tilt up and down, degrees (live).")
    ] = 5.0,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="Frames at each pose (live).")] = 3,
    home: Annotated[
        bool,
        typer.Option("--home", help="Home the stage where its position is unknown (live): it moves for it."),
    ] = False,
    output: Output = DEFAULT_OUTPUT,
    base: Base = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """How the camera sits on the stage: axes, signs and lever arm, from turned views of a fixed board.

    Calibrate the intrinsics first. Put the board 1 to 1.5 m away, turned by some 25°, in view all the time.

    [bold]Examples[/bold]

      lidarboost calibrate mount -c rig.toml --square 50 --base calibration.toml -o calibration.toml

      lidarboost calibrate mount turned.mcap --board 9x6 --square 50
    """
    from math import radians

    from service.calibration.footage import find_views, recorded, turn_around
    from service.calibration.mount import calibrate_mount
    from service.cli.operator import TerminalOperator, with_consent

    check_output(output, base, force)
    printed = board_of(board, square, charuco, marker)
    if recordings:
        footage = recorded(recordings)
    else:
        rig = with_consent(configured(config), home)
        footage = [turn_around(rig, radians(pan), radians(tilt), repeats, TerminalOperator(home))]
    known = base_of(base, footage[0].calibration)
    views = [view for part in footage for view in find_views(part.frames, printed)]
    save(calibrate_mount(views, known), "mount", known, output, as_json)
