"""`lidarboost fuse`: recordings in, fused maps out, with no service running."""

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.preset import PresetOption, configured
from solver.options import Method

if TYPE_CHECKING:
    from service.config.sections import Configuration
    from service.jobs.fuse import Announce
    from service.messages.burst import Burst
    from service.messages.summary import BurstSummary
    from solver.result import Progress as Iterated


def fuse(
    inputs: Annotated[list[Path], typer.Argument(metavar="IN...", help="Recordings, MCAP.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Write frames and maps to this file (one IN).")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            help="Directory: for each IN, NAME-fused.mcap and a picture of every burst; never written over."
        ),
    ] = None,
    method: Annotated[Method | None, typer.Option(help="Which fusion.", show_default="auto")] = None,
    upsampling: Annotated[int | None, typer.Option(min=1, max=16, help="β.", show_default="4")] = None,
    regularization: Annotated[
        str | None, typer.Option(help="λ, metres (phasor: a factor, 1 = auto), or auto.", show_default="auto")
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(min=1, max=200, help="Frames of a burst where none is recorded.", show_default="15"),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Configuration, TOML: sections camera and fusion.")
    ] = None,
    preset: PresetOption = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file of -o where it exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Results as JSON on standard output.")] = False,
) -> None:
    """Fuse every burst of one or more recordings, and show method, λ and quality.

    Errors against the truth are given where a recording holds it (the
    bundled ones do). Inputs that cannot be fused are named and passed
    over; the exit status tells.

    [bold]Examples[/bold]

      lidarboost fuse recordings/wedges.mcap

      lidarboost fuse recordings/*.mcap --output out --method lidarboost

      lidarboost fuse scan.mcap -o fused.mcap --json

    [bold]Exit status[/bold]

    0 done; 1 an input could not be fused; 2 wrong usage; 3 done, but an
    input is damaged.
    """
    from service.files import free_path

    _check(inputs, out, output, force)
    flags = {"method": method, "upsampling": upsampling, "regularization": regularization, "frames": frames}
    configuration = configured(
        config, preset, {"fusion": {key: value for key, value in flags.items() if value is not None}}
    )
    done, failed, damaged = [], False, False
    for path in inputs:
        target = out
        if output is not None:
            target = free_path(output / f"{path.stem}-fused.mcap")
        with _errors_told(go_on=len(inputs) > 1) as errors:
            found = _fuse_one(path, configuration, target, output is not None, quiet=as_json)
            done.append(found)
            damaged |= found["damage"] is not None
        failed |= bool(errors)
    if as_json:
        import json

        print(json.dumps(done, indent=2))
    if failed or damaged:
        raise typer.Exit(1 if failed else 3)


def _check(inputs: list[Path], out: Path | None, output: Path | None, force: bool) -> None:
    from service.errors import OutputError

    if out is not None and output is not None:
        raise typer.BadParameter("-o names one file, --output a directory: choose one of them")
    if out is not None and len(inputs) > 1:
        raise typer.BadParameter(f"-o takes one input, {len(inputs)} are given: use --output DIR")
    targets = [out] if out is not None else []
    if any(target.resolve() == path.resolve() for target in targets for path in inputs):
        raise typer.BadParameter(f"{out} is the input itself: give the result another name")
    if out is not None and out.exists() and not force:
        raise OutputError(f"{out} exists already; choose another name, or replace it with --force")


@contextmanager
def _errors_told(*, go_on: bool) -> Iterator[list[Exception]]:
    """Say what went wrong and go on with the next input; with one input alone the error is the command's."""
    from drivers.errors import DriverError
    from service.errors import ServiceError
    from solver.errors import FusionError

    errors: list[Exception] = []
    try:
        yield errors
    except (DriverError, ServiceError, FusionError) as error:
        if not go_on:
            raise
        errors.append(error)
        print("error:", error, file=sys.stderr)


def _fuse_one(
    path: Path, configuration: "Configuration", target: Path | None, pictures: bool, *, quiet: bool
) -> dict[str, Any]:
    """Fuse a recording; returns what is said of it as JSON."""
    from drivers.recording import open_recording
    from service.capture.rig import configured_calibration
    from service.files import free_path, made_directory
    from service.jobs.fuse import fuse_recording
    from service.messages.summary import describe, summarize
    from service.messages.viewing import Extras
    from service.sinks.drawing import write_preview

    recording = open_recording(path)
    calibration = configured_calibration(configuration.camera)
    found: list[BurstSummary] = []
    with ExitStack() as stack:
        if target is not None:
            stack.enter_context(made_directory(target.parent))
        announce, say = stack.enter_context(_progress(path, recording.frame_count, quiet=quiet))
        extras = Extras(configuration.output.points, configuration.output.depth_mm)
        results = fuse_recording(recording, configuration.fusion, calibration, target, extras, announce)
        for result in results:
            burst = summarize(result, recording.truth)
            found.append(burst)
            say(f"{path.name}: {describe(burst)}")
            if pictures and target is not None:
                picture = target.with_name(f"{path.stem}-burst-{burst.report.burst:04d}.png")
                write_preview(free_path(picture), result, recording.truth)
        if target is not None:
            say(f"wrote {target}")
    if recording.damage is not None:
        print(f"lost: {path}: {recording.damage}", file=sys.stderr)
    return {
        "input": str(path),
        "output": None if target is None else str(target),
        "damage": None if recording.damage is None else str(recording.damage),
        "bursts": [burst.model_dump(mode="json") for burst in found],
    }


@contextmanager
def _progress(path: Path, frames: int, *, quiet: bool) -> Iterator[tuple["Announce", Callable[[str], None]]]:
    """A bar over the frames on a terminal; results as plain lines on standard output either way."""
    if quiet or not sys.stderr.isatty():
        yield (lambda _: None), ((lambda _: None) if quiet else (lambda line: print(line, flush=True)))
        return
    from rich.progress import TimeElapsedColumn

    from service.cli.terminal import bar

    with bar(TimeElapsedColumn()) as shown:
        task = shown.add_task(path.name, total=frames)
        fused = 0

        def announce(burst: "Burst") -> "Iterated":
            nonlocal fused
            shown.update(task, completed=fused)
            fused += len(burst.frames)

            def iterated(iteration: int, _objective: float, _gap: float | None) -> None:
                shown.update(task, description=f"{path.name}, burst {burst.id}, iteration {iteration}")

            return iterated

        yield announce, lambda line: shown.console.print(line, soft_wrap=True)
        shown.update(task, completed=frames, description=path.name)
