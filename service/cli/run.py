"""`lidarboost run`: the service itself."""

import logging
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from service.config.sections import Configuration
    from service.daemon.daemon import Daemon
    from service.fusion.local import LocalExecutor
    from service.messages.summary import RunSummary

_IMPATIENCE = 2.0
"""Seconds after which a second signal is meant: `timeout` and some supervisors send each one twice."""

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
    something not delivered. A daemon told to stop ends with 0.
    """
    from service.cli.operator import with_consent
    from service.config.file import load
    from service.fusion.local import LocalExecutor

    _check(replay, speed, loop, once)
    configuration = with_consent(load(config), home)
    if replay is not None:
        configuration = _playing(configuration, replay, speed or (None if once else 1.0), loop)
    with LocalExecutor.configured(configuration) as executor:  # its process starts while the rest is imported
        served = _served(configuration, executor, output, home=home, once=once, quiet=as_json)
    if served is None:
        return
    summary, told = served
    if as_json:
        print(summary.model_dump_json(indent=2))
    else:
        _tell(summary)
    # A daemon that was told to stop has done its work, whatever it lost on the way.
    if summary.lost and not (told and not once):
        raise typer.Exit(3)


def _served(
    configuration: "Configuration",
    executor: "LocalExecutor",
    output: Path | None,
    *,
    home: bool,
    once: bool,
    quiet: bool,
) -> "tuple[RunSummary, bool] | None":
    """Run the service; what it did and whether it was told to stop, None where it was before it began."""
    from drivers.errors import MotionStoppedError
    from service.capture.rig import make_rig
    from service.cli.operator import TerminalOperator
    from service.cli.progress import progress_sink
    from service.daemon.logs import log_to_stream
    from service.daemon.run import run_service

    log_to_stream(logging.WARNING if once or quiet else logging.INFO)
    rig = make_rig(configuration, operator=TerminalOperator(home, sees_log=not (once or quiet)))
    sinks = {"progress": progress_sink()} if once and not quiet else {}
    with _stopped_by_signals() as signals:
        try:
            summary = run_service(
                configuration,
                rig,
                output=output,
                once=once,
                sinks=sinks,
                executor=executor,
                started=signals.stops,
            )
        except MotionStoppedError as error:  # while the stage was opened: there is nothing to sum up
            if once:
                raise typer.Abort from error
            return None
    return summary, signals.told


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


class _Signals:
    """SIGTERM, SIGHUP and Ctrl-C end the run cleanly; another one some seconds later ends it at once."""

    def __init__(self) -> None:
        self._daemon: Daemon | None = None
        self._first: float | None = None

    @property
    def told(self) -> bool:
        """Whether one came."""
        return self._first is not None

    def stops(self, daemon: "Daemon") -> None:
        """From now on they stop this one; one that came before does so now."""
        self._daemon = daemon
        if self.told:
            daemon.stop.set()

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        now = time.monotonic()
        self._first = self._first or now
        if self._daemon is not None:
            self._daemon.stop.set()
        if now - self._first > _IMPATIENCE:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)


@contextmanager
def _stopped_by_signals() -> Iterator[_Signals]:
    signals = _Signals()
    before = {
        number: signal.signal(number, signals) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    }
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
