"""`lidarboost replay`: a recording in place of a running service's camera."""

from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.commanding import AsJson, add_verb, say
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

if TYPE_CHECKING:
    from service.wire.asking import Answer

_SPEED = "Times real time; 0 = as fast as it can be fused."

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Play a recording in place of a running service's camera.",
)


def in_words(answer: "Answer") -> str:
    """Where a replay is, in a line; with the map of a step in another, and gaps."""
    from service.messages.replay import ReplayState

    told = ReplayState.model_validate(answer["replay"])
    if told.file is None:
        return f"{answer['state']}: no recording is played"
    speed = "as fast as it can" if told.speed is None else f"{told.speed:g} times real time"
    doing = f"playing, {speed}" if told.playing else "at its end" if told.ended else "stands still"
    lines = [
        f"{told.file}: {doing}{', in a loop' if told.loop else ''}; {told.seconds:.1f} of "
        f"{told.duration:.1f} s, frame {told.frame} of {told.frames}, burst {told.burst} of {told.bursts}"
    ]
    lines += [f"gap: its clock jumps by {gap.seconds:.0f} s at frame {gap.frame}" for gap in told.gaps]
    lines += [f"error: {told.error}"] if told.error else []
    if "report" in answer:
        from service.messages.report import BurstReport
        from service.messages.summary import BurstSummary, describe

        report = BurstReport.model_validate(answer["report"])
        lines.append(describe(BurstSummary(report=report, errors=None)))
    return "\n".join(lines)


@app.command()
def load(
    file: Annotated[str, typer.Argument(metavar="FILE", help="In the service's recording folder.")],
    stream: Annotated[
        bool, typer.Option("--stream", help="A map with every frame, not one of each burst.")
    ] = False,
    play: Annotated[bool, typer.Option("--play", help="Go on by itself at once.")] = False,
    speed: Annotated[float, typer.Option(min=0, max=1000, help=_SPEED)] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 300.0,
    as_json: AsJson = False,
) -> None:
    """Open a recording; it stands before its first frame."""
    mode = "stream" if stream else "scan"
    with connected(endpoint, prefix) as rig:
        answer = rig.replay.load(file, timeout, mode=mode, play=play, speed=speed or None, loop=loop)
    say(answer, as_json, in_words)


add_verb(app, "cmd/replay", "play", "Go on; from the beginning where it was at the end.", 10.0, in_words)
add_verb(app, "cmd/replay", "pause", "Stand still after the frame at work.", 10.0, in_words)


@app.command()
def step(
    count: Annotated[int, typer.Argument(min=1, max=10_000, help="How many.")] = 1,
    frames: Annotated[bool, typer.Option("--frames", help="Frames; else what gives a map.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 300.0,
    as_json: AsJson = False,
) -> None:
    """Play some bursts of a scan, or frames of a stream, and stand still."""
    from service.cli.poses import poses_shown

    with connected(endpoint, prefix) as rig, poses_shown(rig):
        answer = rig.replay.step(count, timeout, unit="frame" if frames else None)
    say(answer, as_json, in_words)


@app.command()
def seek(
    seconds: Annotated[
        float | None, typer.Argument(metavar="[SECONDS]", min=0, help="From the first frame.")
    ] = None,
    burst: Annotated[int | None, typer.Option(min=0, help="To the first frame of a burst, from 0.")] = None,
    frame: Annotated[int | None, typer.Option(min=0, help="To a frame, from 0.")] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 10.0,
    as_json: AsJson = False,
) -> None:
    """Go elsewhere; a stream begins anew there."""
    if sum(place is not None for place in (seconds, burst, frame)) != 1:
        raise typer.BadParameter("give one of SECONDS, --burst and --frame")
    with connected(endpoint, prefix) as rig:
        answer = rig.replay.seek(seconds, timeout, burst=burst, frame=frame)
    say(answer, as_json, in_words)


@app.command()
def speed(
    speed: Annotated[float, typer.Argument(min=0, max=1000, help=_SPEED)],
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 10.0,
    as_json: AsJson = False,
) -> None:
    """Play faster or slower."""
    with connected(endpoint, prefix) as rig:
        say(rig.replay.speed(speed or None, timeout), as_json, in_words)


@app.command()
def loop(
    off: Annotated[bool, typer.Option("--off", help="Not any more.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 10.0,
    as_json: AsJson = False,
) -> None:
    """Begin again at the end."""
    with connected(endpoint, prefix) as rig:
        say(rig.replay.loop(not off, timeout), as_json, in_words)


add_verb(app, "cmd/replay", "stop", "End the replay; the service is idle then.", 60.0, in_words)
add_verb(app, "cmd/replay", "get", "Where it is.", 10.0, in_words)
