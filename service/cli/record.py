"""`lidarboost record`: recordings of a running service."""

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.commanding import AsJson, add_verb, say
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

if TYPE_CHECKING:
    from service.wire.asking import Answer

File = Annotated[str, typer.Argument(metavar="FILE", help="In the service's recording folder.")]

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Record, list, keep, fetch and save recordings."
)


def recorder_in_words(answer: "Answer") -> str:
    """What is recorded, in a line."""
    told = answer["recorder"]
    if told["file"] is None:
        return "nothing is recorded"
    doing = "recording" if told["recording"] else "recorded"
    return f"{doing} {told['file']}, {told['messages']} messages"


def listed(answer: "Answer") -> str:
    """A line for each recording, with what saves one that is torn."""
    lines = []
    for one in answer["recordings"]:
        line = f"{one['file']}  {one['size'] / 1e6:.1f} MB  {one['state']}{', kept' if one['kept'] else ''}"
        if one["state"] == "torn":
            line += f"; to save what it holds: lidarboost record recover {shlex.quote(one['file'])}"
        lines.append(line)
    lines += [f"and {answer['more']} older ones"] if answer["more"] else []
    return "\n".join(lines) or "no recordings"


@app.command()
def start(
    maps: Annotated[
        bool | None,
        typer.Option("--maps/--no-maps", help="Fused maps too, not frames alone; else as configured."),
    ] = None,
    replays: Annotated[bool, typer.Option("--replays", help="Also what is played from a recording.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 30.0,
    as_json: AsJson = False,
) -> None:
    """Begin to record."""
    with connected(endpoint, prefix) as rig:
        say(rig.record.start(timeout, maps=maps, replays=replays), as_json, recorder_in_words)


add_verb(app, "cmd/record", "stop", "End the recording, and wait for its file.", 30.0, recorder_in_words)


@app.command()
def keep(
    file: Annotated[str | None, typer.Argument(metavar="[FILE]", help="Else the newest one.")] = None,
    undo: Annotated[bool, typer.Option("--undo", help="It may be deleted again.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 10.0,
    as_json: AsJson = False,
) -> None:
    """Never delete a recording to make room."""
    with connected(endpoint, prefix) as rig:
        say(rig.record.keep(file, timeout, keep=not undo), as_json, recorder_in_words)


@app.command("list")
def list_recordings(
    count: Annotated[int, typer.Option(min=1, max=1000, help="At most so many.")] = 100,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 30.0,
    as_json: AsJson = False,
) -> None:
    """The recordings there are, newest first."""
    with connected(endpoint, prefix) as rig:
        say(rig.record.list(timeout, count=count), as_json, listed)


@app.command()
def fetch(
    file: File,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="PATH", help="A file or a folder; else FILE, here."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 30.0,
    as_json: AsJson = False,
) -> None:
    """Copy a recording from the service to here."""
    import json

    from service.errors import OutputError
    from service.wire.recordings import fetched_to

    target = fetched_to(file, Path() if output is None else output)
    if target.exists() and not force:
        raise OutputError(f"{target} exists already; choose another name, or replace it with --force")
    with connected(endpoint, prefix) as rig, _bytes_shown(file) as shown:
        rig.record.fetch(file, target, timeout, shown)
    size = target.stat().st_size
    print(json.dumps({"file": str(target), "size": size}) if as_json else f"{target}: {size / 1e6:.1f} MB")


@app.command()
def recover(
    file: File,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 600.0,
    as_json: AsJson = False,
) -> None:
    """Make a whole recording, there, of what a torn one still holds; status 3 where something is lost."""
    from service.cli import DATA_LOST

    with connected(endpoint, prefix) as rig:
        answer = rig.record.recover(file, timeout)
    say(answer, as_json, _recovered)
    if answer["recovered"]["lost"] is not None:
        raise typer.Exit(DATA_LOST)


def _recovered(answer: "Answer") -> str:
    told: dict[str, Any] = answer["recovered"]
    lost = "nothing was missing" if told["lost"] is None else f"lost: {told['lost']}"
    return f"{told['file']}: {told['frames']} frames, {told['messages']} messages\n{lost}"


@contextmanager
def _bytes_shown(name: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on a terminal; elsewhere nothing, for a line follows when it is done."""
    import sys

    if not sys.stderr.isatty():
        yield lambda _, __: None
        return
    from rich.progress import TimeRemainingColumn

    from service.cli.terminal import bar

    with bar(TimeRemainingColumn(), "kB") as shown:
        task = shown.add_task(name, total=None)
        yield lambda done, total: shown.update(task, completed=done // 1000, total=total // 1000)
