"""`lidarboost run`: the service itself."""

import gc
import logging
import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.parting import Parting
from service.cli.preset import PresetOption, configured

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.config.sections import Configuration
    from service.daemon.daemon import Daemon
    from service.fusion.executor import Executor
    from service.messages.summary import RunSummary
    from service.signals import Stopping

_REPLAY, _RUN = "Playing a recording", "Running"


def run(
    config: Annotated[
        Path | None, typer.Argument(help="Configuration, TOML; see: lidarboost config schema.")
    ] = None,
    replay: Annotated[
        Path | None, typer.Option(help="Play this recording instead of a camera.", rich_help_panel=_REPLAY)
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.001, max=1000.0, help="Times real time; 1 unless --once.", rich_help_panel=_REPLAY
        ),
    ] = None,
    loop: Annotated[
        bool, typer.Option("--loop", help="Begin again at the end.", rich_help_panel=_REPLAY)
    ] = False,
    once: Annotated[
        bool,
        typer.Option(
            "--once",
            help="One pass: the recording to its end, or one burst; nothing is dropped.",
            rich_help_panel=_RUN,
        ),
    ] = False,
    home: Annotated[
        bool,
        typer.Option(
            "--home",
            help="Home the stage where its position is unknown: it moves beyond the plan.",
            rich_help_panel=_RUN,
        ),
    ] = False,
    preset: PresetOption = None,
    output: Annotated[
        Path | None,
        typer.Option(help="Directory for fused.mcap and a picture of every burst.", rich_help_panel=_RUN),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Say what was done as JSON on standard output.", rich_help_panel=_RUN),
    ] = False,
) -> None:
    """Capture or play frames, fuse them, and publish the maps over Zenoh.

    Without --once it is a daemon: it scans as configured, publishes
    what it fuses, survives lost devices, and ends cleanly on SIGTERM.
    SIGHUP has it read CONFIG again; on a terminal, which has then been
    closed, it ends.

    [bold]Examples[/bold]

    Fuse a recording, save maps and pictures, then end:
      lidarboost run --replay recordings/wedges.mcap --once --output out

    Let a recording stand in for a live camera:
      lidarboost run --replay recordings/wedges.mcap --loop

    The rig that rig.toml describes:
      lidarboost run rig.toml

    One burst of a simulated camera on a simulated stage:
      LIDARBOOST_CAMERA__BACKEND=simulated \\
      LIDARBOOST_STAGE__BACKEND=simulated lidarboost run --once

    [bold]Exit status[/bold]

    0 done; 1 failed; 2 wrong usage or configuration; 3 done, but data
    was lost: a damaged recording, a burst that could not be fused,
    something not delivered; 130 one pass stopped before its first map.
    A daemon told to stop ends with 0, or with 3 where data was lost.
    """
    from service.fusion.process import fusion_process
    from service.leaving import skip_the_end
    from service.signals import stopping

    def read() -> "Configuration":
        from service.cli.operator import with_consent

        found = with_consent(configured(config, preset), home)
        if replay is not None:
            found = _playing(found, replay, speed or (None if once else 1.0), loop)
        return found

    parting = Parting(once)
    reloads = not once and not _has_terminal()
    with stopping(reloads=reloads, give_up=parting.give_up) as signals, ExitStack() as stack:
        _check(replay, speed, loop, once)
        worker = stack.enter_context(fusion_process())  # it starts while the rest is imported
        from service.fusion.configured import configured_executor

        configuration = read()
        executor = stack.enter_context(configured_executor(configuration, worker, spare=not once))
        summary = _served(
            configuration, executor, output, signals, parting, read, home=home, once=once, quiet=as_json
        )
    skip_the_end()
    if summary is None:
        if once:
            raise typer.Abort
        return
    if as_json:
        print(summary.model_dump_json(indent=2))
    else:
        _tell(summary)
    if summary.lost:
        raise typer.Exit(3)


def _served(
    configuration: "Configuration",
    executor: "Executor",
    output: Path | None,
    signals: "Stopping",
    parting: "Parting",
    read: "Callable[[], Configuration]",
    *,
    home: bool,
    once: bool,
    quiet: bool,
) -> "RunSummary | None":
    """Run the service; what it did, None where it was told to stop before it began."""
    from drivers.errors import MotionStoppedError
    from service.capture.configured import make_rig
    from service.cli.operator import TerminalOperator
    from service.cli.progress import progress_sink
    from service.daemon.log_stream import log_to_stream
    from service.daemon.reloading import Reloading
    from service.daemon.run import run_service

    log_to_stream(logging.WARNING if once or quiet else logging.INFO, configuration.log.format)
    rig = make_rig(configuration, operator=TerminalOperator(home, sees_log=not (once or quiet)))
    sinks = {"progress": progress_sink()} if once and not quiet else {}

    def started(daemon: "Daemon") -> None:
        parting.daemon = daemon
        # A collection that walks through all that was imported takes longer than a camera's buffers last.
        daemon.on_ready = gc.freeze
        signals.stops(daemon.stop.set)
        signals.reloads(Reloading(daemon, read).begin)

    if signals.told:
        return None
    try:
        return run_service(
            configuration,
            rig,
            output=output,
            once=once,
            sinks=sinks,
            executor=executor,
            started=started,
            abandoned=parting.leave,
        )
    except MotionStoppedError:  # while the stage was opened: there is nothing to sum up
        return None


def _has_terminal() -> bool:
    """Whether there is one whose end SIGHUP may tell of."""
    return any(os.isatty(descriptor) for descriptor in range(3))


def _check(replay: Path | None, speed: float | None, loop: bool, once: bool) -> None:
    if replay is None and (speed is not None or loop):
        raise typer.BadParameter("--speed and --loop need --replay FILE: they say how a recording is played")
    if once and loop:
        raise typer.BadParameter("--once plays a recording to its end, --loop never ends: choose one of them")


def _playing(configuration: "Configuration", path: Path, speed: float | None, loop: bool) -> "Configuration":
    """The same configuration with a recording for a camera, whose frames say themselves where they looked."""
    options: dict[str, object] = {"path": str(path), "loop": loop}
    if speed is not None:
        options["speed"] = speed
    camera = {"backend": "replay", "options": options, "settings": None}
    stage = {"backend": "none", "options": {}}
    return configuration.model_copy(
        update={
            "camera": configuration.camera.model_copy(update=camera),
            "stage": configuration.stage.model_copy(update=stage),
        }
    )


def _tell(summary: "RunSummary") -> None:
    """What was done, with units, on standard output."""
    print(
        f"{summary.frames} frames of {summary.model} ({summary.source}), {summary.bursts} bursts, "
        f"{summary.maps} maps, {summary.published} messages published, {summary.seconds:.1f} s"
    )
    if summary.files:
        print("wrote", ", ".join(summary.files))
    for loss in summary.lost:
        print("lost:", loss, file=sys.stderr)
