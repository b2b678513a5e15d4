"""`lidarboost simulate`: records what a simulated camera sees while a simulated stage turns it."""

import json
from pathlib import Path
from typing import Annotated

import typer

_POSES, _DEVICES = "What is recorded", "How well it is made"
_CALIBRATING = "To calibrate with"


def simulate(
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write (MCAP).")],
    scene: Annotated[
        str,
        typer.Option(
            help="wedges: thin wedges, panels with holes, many edges; objects: ball, basket, cup, a box with "
            "black print; plane, step, sphere: simple ones; board: to calibrate with.",
            rich_help_panel=_POSES,
        ),
    ] = "wedges",
    frames: Annotated[
        int, typer.Option("--frames", "-n", min=1, max=200, help="Poses of a burst.", rich_help_panel=_POSES)
    ] = 15,
    span: Annotated[
        float,
        typer.Option(
            min=0, max=40, help="Width of the field of poses, end to end, pixels.", rich_help_panel=_POSES
        ),
    ] = 15.0,
    bursts: Annotated[
        int, typer.Option(min=1, max=1000, help="Times that the poses are taken.", rich_help_panel=_POSES)
    ] = 1,
    integration_time: Annotated[
        float,
        typer.Option(
            min=0.2, max=100, help="Per phase sample, ms; noise falls as it grows.", rich_help_panel=_POSES
        ),
    ] = 30.0,
    frequency: Annotated[
        float,
        typer.Option(min=1, max=100, help="Modulation, MHz: 20 = a range of 7.5 m.", rich_help_panel=_POSES),
    ] = 20.0,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            help="Of noise and pointing errors; the same seed, the same frames.",
            rich_help_panel=_POSES,
        ),
    ] = 0,
    noise: Annotated[bool, typer.Option(help="Sensor noise.", rich_help_panel=_DEVICES)] = True,
    away: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=100,
            help="Metres to the wall of plane or the middle of board; none = 2 and 1.15.",
            rich_help_panel=_CALIBRATING,
        ),
    ] = None,
    views: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=200,
            help="Show the board in so many poses, one frame each, in place of a scan.",
            rich_help_panel=_CALIBRATING,
        ),
    ] = None,
    board: Annotated[
        str,
        typer.Option(help="Inner corners of the board: columns x rows.", rich_help_panel=_CALIBRATING),
    ] = "9x6",
    square: Annotated[
        float,
        typer.Option(min=1, max=1000, help="Side of a field, mm.", rich_help_panel=_CALIBRATING),
    ] = 50.0,
    camera: Annotated[
        Path | None,
        typer.Option(
            help="Calibration file of the camera that is simulated: its true optics, errors, noise, mount.",
            rich_help_panel=_CALIBRATING,
        ),
    ] = None,
    calibrated: Annotated[
        bool,
        typer.Option(
            "--calibrated/--uncalibrated",
            help="Whether the recording's calibration is the true one, else nominal, the true one beside it.",
            rich_help_panel=_CALIBRATING,
        ),
    ] = True,
    lever_arm: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Projection centre from the stage's axes, metres: right, down, forward.",
            rich_help_panel=_DEVICES,
        ),
    ] = None,
    resolution: Annotated[
        float,
        typer.Option(min=0, max=5, help="The stage's smallest step, degrees.", rich_help_panel=_DEVICES),
    ] = 0.01,
    pointing_error: Annotated[
        float,
        typer.Option(
            min=0, max=1, help="How far it stops from where it says, degrees (σ).", rich_help_panel=_DEVICES
        ),
    ] = 0.003,
    force: Annotated[bool, typer.Option(help="Replace a file that exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say what was done as JSON.")] = False,
) -> None:
    """Record a simulated scan, with its ground truth.

    A 176 × 144 camera with SR3000 optics looks at a scene, is turned to each pose, and takes one frame there:
    phasors averaged over each pixel (so edges have flying pixels), noise, 16-bit counts. The recording holds
    the frames, the angles the stage reported, calibration, configuration, and the noise-free truth of the
    first pose at four times the resolution (attachment truth.npz), against which `evaluate`, `fuse` and `run`
    state their errors.

    Try:  lidarboost simulate --scene objects -n 15 --span 30 -o objects.mcap

    then: lidarboost run --replay objects.mcap --once --output out

    A camera with other optics and errors, to be found by calibrate:

      lidarboost simulate --scene board --views 20 --camera true.toml --uncalibrated -o board.mcap

      lidarboost simulate --scene plane --away 1.5 --span 0 --camera true.toml --uncalibrated -o wall.mcap
    """
    from drivers.settings import CameraSettings
    from drivers.simulation import SCENES
    from service.cli.calibrating import board_of
    from service.cli.counter import counted
    from service.config.sections import CameraSection, Configuration, FusionSection, PlanSection, StageSection
    from service.errors import ConfigurationError, OutputError
    from service.jobs.simulate import record_simulation

    if scene not in SCENES:
        raise ConfigurationError(f"--scene: no scene is called {scene!r}; there are: {', '.join(SCENES)}")
    if views is not None and scene != "board":
        raise ConfigurationError(f"--views shows a board in other poses; expected --scene board, not {scene}")
    printed = board_of(board, square, None, 0.0)
    options: dict[str, object] = {"scene": scene, "seed": seed, "noise": noise}
    if camera is None or lever_arm is not None:
        options["lever_arm"] = list(lever_arm or (0.0, 0.0, 0.0))
    if scene == "board":
        options |= {"board": [printed.columns, printed.rows], "square": printed.square}
    options |= {} if away is None else {"away": away}
    options |= {} if camera is None else {"calibration": str(camera)}
    options |= {} if calibrated else {"calibrated": False}
    if views is not None:
        frames, bursts = 1, views
    if output.exists() and not force:
        raise OutputError(f"{output} exists already; choose another name, or replace it with --force")
    configuration = Configuration(
        camera=CameraSection(
            backend="simulated",
            options=options,
            settings=CameraSettings(
                integration_time=integration_time / 1e3, modulation_frequency=frequency * 1e6
            ),
        ),
        stage=StageSection(
            backend="simulated",
            options={"resolution": resolution, "pointing_error": pointing_error, "seed": seed},
            resolution=resolution,
        ),
        plan=PlanSection(span=span),
        fusion=FusionSection(frames=frames),
    )
    with counted(frames * bursts, "simulating") as advance:
        done = record_simulation(configuration, output, bursts, advance, views is not None)
    if as_json:
        print(json.dumps(done.model_dump(mode="json"), indent=2))
    else:
        print(done)
