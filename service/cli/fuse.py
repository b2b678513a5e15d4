"""`lidarboost fuse`: recordings in, fused maps out, with no service running."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.preset import PresetOption, configured
from solver.options import Method

if TYPE_CHECKING:
    from service.jobs.fuse import Announce
    from service.jobs.task import FileResult, FuseTask
    from service.messages.burst import Burst
    from service.messages.summary import BurstSummary
    from solver.result import Progress as Iterated

_MANY = "Many recordings"


def fuse(
    inputs: Annotated[
        list[Path],
        typer.Argument(metavar="IN...", help="Recordings, MCAP, or folders of them."),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Write frames and maps to this file (one IN).")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            help="Directory: for each IN, NAME-DIGEST-fused.mcap and a picture of every burst; the digest is "
            "of content and settings, and what is there already is not done again."
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
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, max=1024, help="Processes here.", show_default="one per core", rich_help_panel=_MANY
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of a Dask cluster, such as tcp://10.0.0.7:8786, whose workers see the files "
            "under the same paths.",
            rich_help_panel=_MANY,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file of -o where it exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Results as JSON on standard output.")] = False,
) -> None:
    """Fuse every burst of one or more recordings, and show method, λ and quality.

    Errors against the truth are given where a recording holds it (the
    bundled ones do). Inputs and bursts that cannot be fused are named and
    passed over; the exit status tells.

    [bold]Examples[/bold]

      lidarboost fuse recordings/wedges.mcap

      lidarboost fuse recordings/ --output out --method lidarboost

      lidarboost fuse scan.mcap -o fused.mcap --json

      lidarboost fuse /data/2026 --output /data/maps --cluster 10.0.0.7:8786

    [bold]Exit status[/bold]

    0 done; 1 an input could not be fused; 2 wrong usage; 3 done, but an
    input is damaged, or not all of its bursts could be fused.
    """
    from service.cli.fuse_many import fuse_many
    from service.jobs.result_name import recordings_among

    if workers is not None and cluster is not None:
        raise typer.BadParameter("--workers are processes here, --cluster is elsewhere: choose one of them")
    _check(inputs, out, output, force)
    flags = {"method": method, "upsampling": upsampling, "regularization": regularization, "frames": frames}
    given: dict[str, object] = {"fusion": {key: value for key, value in flags.items() if value is not None}}
    make = _task_maker(config, preset, given, out, output, remote=cluster is not None)
    paths = recordings_among(inputs)
    if out is not None and len(paths) > 1:
        raise typer.BadParameter(f"-o takes one input, {len(paths)} are given: use --output DIR")
    tasks = [make(path) for path in paths]
    if len(tasks) == 1 and cluster is None:
        done = [_fuse_one(tasks[0], quiet=as_json)]
    else:
        done = fuse_many(tasks, workers, cluster, quiet=as_json)
    if as_json:
        import json

        print(json.dumps([result.model_dump(mode="json") for result in done], indent=2))
    failed = any(result.error is not None for result in done)
    if failed or any(result.lost for result in done):
        raise typer.Exit(1 if failed else 3)


def _check(inputs: Sequence[Path], out: Path | None, output: Path | None, force: bool) -> None:
    from service.errors import OutputError

    if out is not None and output is not None:
        raise typer.BadParameter("-o names one file, --output a directory: choose one of them")
    if out is not None and len(inputs) > 1:
        raise typer.BadParameter(f"-o takes one input, {len(inputs)} are given: use --output DIR")
    if out is not None and any(out.resolve() == path.resolve() for path in inputs):
        raise typer.BadParameter(f"{out} is the input itself: give the result another name")
    if out is not None and out.exists() and not force:
        raise OutputError(f"{out} exists already; choose another name, or replace it with --force")


def _task_maker(
    config: Path | None,
    preset: str | None,
    given: dict[str, object],
    out: Path | None,
    output: Path | None,
    *,
    remote: bool,
) -> "Callable[[Path], FuseTask]":
    """What makes a task of a path; its calibration is looked at once, before anything is begun."""
    from service.capture.configured import configured_calibration
    from service.jobs.task import FuseTask
    from service.messages.viewing import Extras

    found = configured(config, preset, given)
    configured_calibration(found.camera)
    extras = Extras(found.output.points, found.output.depth_mm)

    def seen(path: Path | None) -> Path | None:
        """Workers elsewhere have another working directory."""
        return path.absolute() if remote and path is not None else path

    def make(path: Path) -> FuseTask:
        recording = path.absolute() if remote else path
        return FuseTask(
            recording, found.fusion, seen(found.camera.calibration), extras, seen(out), seen(output)
        )

    return make


def _fuse_one(task: "FuseTask", *, quiet: bool) -> "FileResult":
    """Fuse a recording here, and tell of each burst as it is done; its error is the command's."""
    from service.cli.fuse_many import tell
    from service.jobs.task import fuse_file
    from service.messages.summary import describe

    with _progress(task.path, quiet=quiet) as (begun, announce, say):

        def heard(burst: "BurstSummary") -> None:
            say(f"{task.path.name}: {describe(burst)}")

        result = fuse_file(task, announce, heard, begun)
    told = result if result.resumed else result.model_copy(update={"bursts": ()})
    tell(told, quiet=quiet)
    return result


@contextmanager
def _progress(
    path: Path, *, quiet: bool
) -> Iterator[tuple[Callable[[int], None], "Announce", Callable[[str], None]]]:
    """A bar over the frames on a terminal; results as plain lines on standard output either way.

    Yields what is to be told how many frames there are, of each burst, and of each result.
    """
    if quiet or not sys.stderr.isatty():
        say = (lambda _: None) if quiet else (lambda line: print(line, flush=True))
        yield (lambda _: None), (lambda _: None), say
        return
    from rich.progress import TimeElapsedColumn

    from service.cli.terminal import bar

    with bar(TimeElapsedColumn()) as shown:
        task = shown.add_task(path.name, total=None)
        frames = fused = 0

        def begun(count: int) -> None:
            nonlocal frames
            frames = count
            shown.update(task, total=count)

        def announce(burst: "Burst") -> "Iterated":
            nonlocal fused
            shown.update(task, completed=fused)
            fused += len(burst.frames)

            def iterated(iteration: int, _objective: float | None, _gap: float | None) -> None:
                shown.update(task, description=f"{path.name}, burst {burst.id}, iteration {iteration}")

            return iterated

        yield begun, announce, lambda line: shown.console.print(line, soft_wrap=True)
        shown.update(task, completed=frames, description=path.name)
