"""`lidarboost scan`: bursts of a running service."""

from typing import TYPE_CHECKING

import typer

from service.cli.commanding import AsJson, add_verb, connected, say
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout

if TYPE_CHECKING:
    from service.wire.asking import Answer

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Have a running service scan: burst after burst, or one."
)

add_verb(app, "cmd/scan", "start", "Scan burst after burst.", 60.0)
add_verb(app, "cmd/scan", "stop", "End after the burst at work.")
add_verb(app, "cmd/scan", "cancel", "End at once; the burst at work is discarded.")
add_verb(app, "cmd/scan", "pause", "Stand still after the pose at work.")
add_verb(app, "cmd/scan", "resume", "Go on with the burst that was paused.")


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
