"""The command line: a table of commands, each imported only when it is used, and what their errors mean."""

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from service import leaving, signals, streams
from service.versions import software_version

DONE, FAILED, USAGE, DATA_LOST = 0, 1, 2, 3
"""Exit statuses."""

INTERRUPTED = 130
"""What shells report for a program ended by SIGINT: 128 + 2."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One command: `attribute` of `module` is a plain function, or a `typer.Typer` with its own commands."""

    module: str
    attribute: str
    summary: str
    panel: str


_DAEMON, _LIVE = "The service", "Talking to a running service"
_RECORDINGS, _DEVICES, _REST = "Recordings", "Devices", "Everything else"

COMMANDS: dict[str, Entry] = {
    "run": Entry("service.cli.run", "run", "Capture or play, fuse and publish: the service itself.", _DAEMON),
    "status": Entry("service.cli.status", "status", "Show how a running service is doing.", _LIVE),
    "get": Entry("service.cli.get", "get", "Show or save the latest value of a topic.", _LIVE),
    "watch": Entry("service.cli.watch", "watch", "Print the messages of a topic as they come.", _LIVE),
    "rigs": Entry("service.cli.rigs", "rigs", "List the rigs that are alive, and what they do.", _LIVE),
    "view": Entry(
        "service.cli.view", "view", "Show a recording or a rig in Rerun, or a rig in a browser.", _LIVE
    ),
    "scan": Entry("service.cli.scan", "app", "Have it scan: start, stop, cancel, once, pause …", _LIVE),
    "stream": Entry("service.cli.stream", "app", "Have it fuse every frame: start, stop.", _LIVE),
    "record": Entry("service.cli.record", "app", "Record; list, keep, fetch, save recordings.", _LIVE),
    "replay": Entry("service.cli.replay", "app", "Play a recording in place of its camera.", _LIVE),
    "stage": Entry("service.cli.stage", "app", "Ask, stop or home its stage.", _LIVE),
    "settings": Entry("service.cli.sections", "settings", "Show or change the camera's settings.", _LIVE),
    "plan": Entry("service.cli.sections", "plan", "Show or change the plan of poses.", _LIVE),
    "fusion": Entry("service.cli.sections", "fusion", "Show or change how frames are fused.", _LIVE),
    "simulate": Entry(
        "service.cli.simulate", "simulate", "Record a simulated scan with its ground truth.", _RECORDINGS
    ),
    "import": Entry("service.cli.import_", "import_frames", "Make a recording of camera files.", _RECORDINGS),
    "info": Entry("service.cli.info", "info", "Show what a recording holds and what it lacks.", _RECORDINGS),
    "export": Entry("service.cli.export", "export", "Export to NumPy or PLY.", _RECORDINGS),
    "recover": Entry("service.cli.recover", "recover", "Save what a torn recording holds.", _RECORDINGS),
    "fuse": Entry("service.cli.fuse", "fuse", "Fuse recordings offline.", _RECORDINGS),
    "devices": Entry(
        "service.cli.devices", "app", "List devices; learn a camera from a USB trace.", _DEVICES
    ),
    "doctor": Entry("service.cli.doctor", "doctor", "Check this machine, and say how to mend it.", _DEVICES),
    "capture": Entry("service.cli.capture", "capture", "Record a few frames, with a picture.", _DEVICES),
    "hz": Entry("service.cli.hz", "hz", "Show frame rate, jitter and drops.", _DEVICES),
    "quality": Entry("service.cli.quality", "quality", "Measure how well a rig measures.", _DEVICES),
    "calibrate": Entry(
        "service.cli.calibrate", "calibrate", "Find a camera's optics, errors, noise and mount.", _DEVICES
    ),
    "evaluate": Entry("service.cli.evaluate", "evaluate", "Compare the methods on a known depth map.", _REST),
    "config": Entry("service.cli.config", "config", "Check a configuration, or show its schema.", _REST),
}
"""Every command, in the order that help shows them."""

_STOPPING = frozenset({"run", "capture"})
"""Commands for which a signal is a wish to stop, and no interruption."""


class LazyGroup(TyperGroup):
    """Looks commands up in the table, and turns every error into one line and an exit status."""

    _listing = False

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        if self._listing:
            return TyperCommand(
                cmd_name, callback=None, help=entry.summary, rich_help_panel=entry.panel, params=[]
            )
        return _load(cmd_name, entry)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        self._listing = True
        try:
            super().format_help(ctx, formatter)
        finally:
            self._listing = False

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        extra["standalone_mode"] = False
        try:
            status = super().main(*args, **extra)
            if status == INTERRUPTED:  # how the library tells of a KeyboardInterrupt
                raise KeyboardInterrupt
        except (Exception, KeyboardInterrupt) as error:
            status = _report(error)
        status = _settled(status)
        if not standalone_mode:
            return status
        sys.exit(status if isinstance(status, int) else DONE)


def _load(name: str, entry: Entry) -> Any:
    found: typer.Typer | Callable[..., Any] = getattr(import_module(entry.module), entry.attribute)
    if not isinstance(found, typer.Typer):
        single = typer.Typer(add_completion=False, rich_markup_mode="rich")
        single.command(name)(found)
        found = single
    command = typer.main.get_command(found)
    command.name = name
    return command


def _settled(status: Any) -> Any:
    """The status, where what belongs on standard output has arrived there or nobody waits for it."""
    with suppress(ValueError):  # closed by whoever took it for the command
        sys.stdout.flush()
    why = streams.loss()
    return status if why is None or status else _say(f"standard output: {why}", FAILED)


def _report(error: BaseException) -> int:
    """Say on standard error what went wrong, in one line; returns the exit status."""
    from drivers.errors import DriverError
    from service.errors import ConfigurationError, ServiceError
    from solver.errors import FusionError

    if os.environ.get("LIDARBOOST_DEBUG"):
        raise error
    if isinstance(error, (typer.Abort, KeyboardInterrupt)):
        return _say("interrupted", INTERRUPTED)
    if isinstance(error, typer.TyperException):
        return _say(_usage(error), error.exit_code)
    if isinstance(error, ConfigurationError):
        return _say(str(error), USAGE)
    if isinstance(error, (ServiceError, DriverError, FusionError)):
        return _say(str(error), FAILED)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return _say(f"{where}{error.strerror or error}", FAILED)
    fault = f"{type(error).__name__}: {error}"
    return _say(f"internal error, {fault} (set LIDARBOOST_DEBUG=1 to see where)", FAILED)


def _usage(error: typer.TyperException) -> str:
    context = getattr(error, "ctx", None)
    message = error.format_message().rstrip(".")
    return f"{message} (see: {context.command_path} --help)" if context is not None else message


def _say(message: str, status: int) -> int:
    print("error:", " ".join(message.split()), file=sys.stderr)
    return status


def _print_version(wanted: bool) -> None:
    if wanted:
        print("lidarboost", software_version())
        raise typer.Exit


app = typer.Typer(cls=LazyGroup, rich_markup_mode="rich", pretty_exceptions_enable=False, add_completion=True)


@app.callback(
    invoke_without_command=True,
    epilog="Exit status: 0 done, 1 failed, 2 wrong usage or configuration, 3 done with data lost. "
    "Errors are one line on standard error; LIDARBOOST_DEBUG=1 adds the traceback.",
)
def _root(
    context: typer.Context,
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Live depth superresolution for SwissRanger-class time-of-flight cameras.

    Begin with a recording:

      lidarboost run --replay recordings/wedges.mcap --once --output out

    or make one of your own:

      lidarboost simulate --output scan.mcap
    """
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(USAGE)
    if context.invoked_subcommand not in _STOPPING:
        context.with_resource(signals.interrupting())


def main() -> NoReturn:
    """Run the command line; raises SystemExit."""
    streams.settle()
    try:
        app(prog_name="lidarboost")
    except SystemExit as told:
        leaving.leave(told.code if isinstance(told.code, int) else DONE)
        raise
    raise SystemExit(DONE)
