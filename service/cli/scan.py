"""`lidarboost scan`: bursts of a running service."""

from typing import TYPE_CHECKING

import typer

from service.cli.commanding import AsJson, add_verb, say
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

if TYPE_CHECKING:
    from service.wire.asking import Answer

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Have a running service scan: burst after burst, or one."
)


def check_in_words(answer: "Answer") -> str:
    """A line for each thing that it tells."""
    told = answer["check"]
    exposure = told["exposure"]
    noise = "not known" if exposure["noise"] is None else f"{exposure['noise'] * 1000:.1f} mm a frame"
    lines = [
        f"{told['poses']} poses in about {told['seconds']:.1f} s; {told['coverage']:.0%} of the sub-pixel "
        f"phases (rows {told['rows']:.0%}, columns {told['columns']:.0%}); parallax "
        f"{told['parallax']:.3f} pixels",
        f"exposure: {exposure['saturated']:.1%} saturated, {exposure['dark']:.1%} dark; noise {noise}",
        f"amplitude, 0 to {exposure['histogram_top']:.0f} counts: {_bars(exposure['histogram'])}",
    ]
    return "\n".join([*lines, *(f"advice: {line}" for line in told["advice"])])


def _bars(counts: list[int]) -> str:
    most = max(1, *counts)
    return "".join(" ▁▂▃▄▅▆▇█"[round(8 * count / most)] for count in counts)


add_verb(app, "cmd/scan", "start", "Scan burst after burst.", 60.0)
add_verb(app, "cmd/scan", "stop", "End after the burst at work.")
add_verb(app, "cmd/scan", "cancel", "End at once; the burst at work is discarded.")
add_verb(app, "cmd/scan", "pause", "Stand still after the pose at work.")
add_verb(app, "cmd/scan", "resume", "Go on with the burst that was paused.")
add_verb(app, "cmd/scan", "check", "What a burst would give; nothing moves.", 60.0, check_in_words)


@app.command()
def once(
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 300.0,
    as_json: AsJson = False,
) -> None:
    """One burst and its map, which `get fused/depth -o FILE` then saves."""
    from service.cli.poses import poses_shown

    with connected(endpoint, prefix) as rig, poses_shown(rig):
        answer = rig.scan.once(timeout)
    say(answer, as_json, _report)


def _report(answer: "Answer") -> str:
    from service.messages.report import BurstReport
    from service.messages.summary import BurstSummary, describe

    return describe(BurstSummary(report=BurstReport.model_validate(answer["report"]), errors=None))
