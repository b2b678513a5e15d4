"""`lidarboost quality`: how well a rig measures, in figures that can be required."""

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.preset import PresetOption, configured
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix
from solver.options import Method

if TYPE_CHECKING:
    from service.evaluation.quality import Figure, Quality
    from service.evaluation.regions import Region
    from service.evaluation.requirements import Requirement
    from service.evaluation.sight import Take
    from service.jobs.quality import Footage

_WHAT, _HOW, _RIG = "What is judged", "How frames are fused", "A running rig"

_MEANINGS = {
    "flatness": "RMS from the best plane",
    "fill": "of the pixels have a distance",
    "noise": "of a pixel in time",
    "repeatability": "of the mean from burst to burst",
    "bias": "measured − true",
    "step": "between the first two regions",
    "edge": "wide from 10 to 90 %",
}


def quality(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE]", help="A recording or a file of maps, MCAP; none = a running rig."),
    ] = None,
    region: Annotated[
        list[str] | None,
        typer.Option(
            "--region",
            help="whole, planes (found), or TOP,LEFT,HEIGHT,WIDTH in pixels of a frame; two for a step.",
            show_default="planes",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=1000,
            help="True perpendicular distance of the first region, metres.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            help="Inner corners of a chessboard in view, as 9x6: the truth, and the region.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    square: Annotated[
        float, typer.Option(min=1, max=1000, help="Side of its fields, mm.", rich_help_panel=_WHAT)
    ] = 50.0,
    require: Annotated[
        list[str] | None,
        typer.Option("--require", help="Such as flatness<3mm or fill>95%; exit status 1 where it is not so."),
    ] = None,
    bursts: Annotated[
        int, typer.Option(min=1, max=100, help="Bursts that are judged at most; of a rig, waited for.")
    ] = 5,
    method: Annotated[
        Method | None, typer.Option(help="Which fusion.", show_default="auto", rich_help_panel=_HOW)
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(help="Configuration, TOML: sections camera and fusion.", rich_help_panel=_HOW),
    ] = None,
    preset: PresetOption = None,
    picture: Annotated[Path | None, typer.Option(help="Save a picture of the first burst, PNG.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The figures as JSON.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Annotated[
        float,
        typer.Option(min=0.1, max=86400, help="Seconds to wait for each map.", rich_help_panel=_RIG),
    ] = 120.0,
) -> None:
    """Measure how well a recording, a file of maps or a running rig measures, before and after fusion.

    Frames are fused, maps that a file holds are judged as they are unless
    a method, a configuration or a preset is named. Bursts that cannot be
    fused are named and passed over. Of regions that are given the worst
    counts, of planes found the largest. What cannot be measured is null,
    and said why.

    [bold]Examples[/bold]

      lidarboost quality wall.mcap

      lidarboost quality wall.mcap --distance 2.0 --require "flatness<3mm" --require "bias<5mm"

      lidarboost quality step.mcap --region 40,30,60,40 --region 40,100,60,40 --picture step.png

      lidarboost quality --bursts 10 --json

    [bold]Exit status[/bold]

    0 done; 1 failed, or a requirement is not met; 2 wrong usage, or a
    requirement of what cannot be measured; 3 done, but the file is damaged,
    or not all of its bursts could be fused.
    """
    from service.evaluation.quality import measure
    from service.evaluation.quality_picture import write_quality
    from service.evaluation.regions import PLANES, parse_region
    from service.evaluation.requirements import parse_requirement

    requirements = [parse_requirement(text) for text in require or ()]
    for text in region or ():
        parse_region(text)
    if distance is not None and board is not None:
        raise typer.BadParameter("--distance and --board both tell the truth: give one of them")
    if file is None:
        footage, damage = _of_rig(endpoint, prefix, bursts, timeout), None
    else:
        footage, damage = _of_file(file, bursts, method, config, preset)
    take = footage.takes[0]
    regions, known = _judged(take, region, board, square, distance)
    found = not board and region in (None, [], [PLANES])
    result = measure(
        footage.takes,
        regions,
        found=found,
        known=known,
        source=str(file) if file is not None else f"{prefix} at {endpoint}",
        method=footage.method,
        frames=footage.frames,
        notes=footage.notes,
        failures=footage.failures,
    )
    if picture is not None:
        write_quality(picture, result, take, regions, found=found)
    status = _said(result, requirements, as_json=as_json)
    lost = [*footage.failures, *(() if damage is None else (damage,))]
    for what in lost:
        print(f"lost: {file}: {what}", file=sys.stderr)
    if status or lost:
        raise typer.Exit(status or 3)


def _of_rig(endpoint: str, prefix: str, bursts: int, timeout: float) -> "Footage":
    from service.jobs.quality_live import gathered
    from service.wire.client import Client

    with Client(endpoint, prefix) as client:
        return gathered(client, bursts, timeout)


def _of_file(
    path: Path, bursts: int, method: Method | None, config: Path | None, preset: str | None
) -> "tuple[Footage, object]":
    from drivers.recording import Recording, open_recording
    from service.capture.configured import configured_calibration
    from service.cli.counter import counted
    from service.jobs.quality import fused_before, fused_now
    from service.messages.topics import FUSED_DEPTH

    flags = {} if method is None else {"fusion": {"method": method}}
    configuration = configured(config, preset, flags)
    calibration = configured_calibration(configuration.camera)
    recording = Recording(path)
    has_maps = FUSED_DEPTH in recording.topics
    if has_maps and not (method or config or configuration.preset):
        return fused_before(recording, bursts, calibration), recording.damage
    recording = open_recording(path)
    count = min(bursts, len(recording.cut(configuration.fusion.frames)))
    with counted(count, "fusing", "bursts") as advance:
        footage = fused_now(recording, configuration.fusion, bursts, calibration, advance)
    return footage, recording.damage


def _judged(
    take: "Take", texts: Sequence[str] | None, board: str | None, square: float, distance: float | None
) -> "tuple[list[Region], Any]":
    """The regions, and what is known of the first."""
    from service.evaluation.regions import PLANES, regions_of

    if board is None:
        return regions_of(texts or [PLANES], take), distance
    from service.cli.calibrating import board_of
    from service.jobs.known_board import board_region

    seen, plane = board_region(take, board_of(board, square, None, 0.0))
    return [seen, *regions_of(texts or (), take)], plane


def _said(result: "Quality", requirements: "Sequence[Requirement]", *, as_json: bool) -> int:
    """Show the figures and what became of the requirements; returns the exit status."""
    values = {rule.text: getattr(result, rule.name).after for rule in requirements}
    met = {rule.text: None if (v := values[rule.text]) is None else rule.is_met(v) for rule in requirements}
    if as_json:
        judged = [{"requirement": text, "value": values[text], "met": met[text]} for text in values]
        print(json.dumps({**result.model_dump(mode="json"), "requirements": judged}, indent=2))
    else:
        print("\n".join(_lines(result)))
    for rule in requirements:
        if met[rule.text] is None:
            why = getattr(result, rule.name).why
            print(f"error: {rule.text}: {rule.name} cannot be measured: {why}", file=sys.stderr)
        elif not as_json or not met[rule.text]:
            verdict = "met" if met[rule.text] else "NOT met"
            value = _shown(rule.name, values[rule.text]).strip()
            print(f"{rule.text}: {verdict}, it is {value}", file=sys.stdout if not as_json else sys.stderr)
    if None in met.values():
        return 2
    return 0 if all(met.values()) else 1


def _lines(result: "Quality") -> Iterator[str]:
    without = f" ({len(result.failures)} not fused)" if result.failures else ""
    yield (
        f"{result.source}: {_counted(result.bursts, 'burst')}{without}, {_counted(result.frames, 'frame')}, "
        f"{result.method or 'method not said'}, β = {result.upsampling}"
    )
    yield f"  {'':<14}{'before':>12}{'after':>12}"
    for name in _MEANINGS:
        yield _line(name, getattr(result, name))
    for part in result.regions:
        away = "" if part.away is None else f", {part.away:.3f} m away"
        figures = ", ".join(
            f"{name} {_shown(name, figure.before)} → {_shown(name, figure.after)}"
            for name in ("flatness", "fill", "noise", "repeatability")
            if (figure := getattr(part, name)).why is None
        )
        yield f"{part.name}: {part.share:.1%} of the view{away}; {figures}"
    yield from (f"note: {note}" for note in result.notes)


def _line(name: str, figure: "Figure") -> str:
    what = _MEANINGS[name] if figure.why is None else f"– {figure.why}"
    return f"  {name:<14}{_shown(name, figure.before):>12}{_shown(name, figure.after):>12}   {what}"


def _shown(name: str, value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.2%}" if name == "fill" else f"{value * 1e3:.2f} mm"


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
