"""`lidarboost simulate`: records what a simulated camera sees while a simulated stage turns it."""

import json
from pathlib import Path
from typing import Annotated

import typer

_POSES, _DEVICES = "What is recorded", "How well it is made"


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
    lever_arm: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="X Y Z",
            help="Projection centre from the stage's axes, metres: right, down, forward.",
            rich_help_panel=_DEVICES,
        ),
    ] = (0.0, 0.0, 0.0),
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
    """
    from drivers.settings import CameraSettings
    from drivers.simulation import SCENES
    from service.cli.counter import counted
    from service.config.sections import CameraSection, Configuration, FusionSection, PlanSection, StageSection
    from service.errors import ConfigurationError, OutputError
    from service.jobs.simulate import record_simulation

    if scene not in SCENES:
        raise ConfigurationError(f"--scene: no scene is called {scene!r}; there are: {', '.join(SCENES)}")
    if output.exists() and not force:
        raise OutputError(f"{output} exists already; choose another name, or replace it with --force")
    configuration = Configuration(
        camera=CameraSection(
            backend="simulated",
            options={"scene": scene, "seed": seed, "noise": noise, "lever_arm": list(lever_arm)},
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
        done = record_simulation(configuration, output, bursts, advance)
    if as_json:
        print(json.dumps(done.model_dump(mode="json"), indent=2))
    else:
        print(done)
