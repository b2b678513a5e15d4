"""`lidarboost status`: how a running service is doing."""

from collections.abc import Iterator
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

if TYPE_CHECKING:
    from service.messages.status import Status


def status(
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    prefix: Prefix = DEFAULT_PREFIX,
    timeout: Timeout = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="The status as it was published.")] = False,
) -> None:
    """Show how a running service is doing: state, rates, drops by cause, recording, last error."""
    import json

    from service.messages.decoding import read
    from service.messages.status import Status

    with connected(endpoint, prefix) as client:
        received = client.latest("status", timeout)
    if as_json:
        print(json.dumps(received.value, indent=2))
    else:
        told = read(Status, received)
        print("\n".join(f"{name:<10} {said}" for name, said in _lines(told)))


def _lines(told: "Status") -> Iterator[tuple[str, str]]:
    serial = f", serial {told.serial}" if told.serial else ""
    paused = ", paused" if told.paused else ""
    why = f": {told.reason}" if told.reason else ""
    yield "state", f"{told.state} for {told.seconds:.0f} s{paused}{why}"
    yield "service", f"lidarboost {told.version}, up {told.uptime:.0f} s"
    yield "source", f"{told.source}: {told.model}{serial}" if told.source else "no camera"
    latency = "" if told.latency is None else f", {told.latency:.2f} s after the last frame"
    bursts = f", {told.totals.bursts} whole bursts" if told.totals.bursts else ""
    yield "frames", f"{told.totals.frames}{bursts}, {told.rates.frames:.1f} per second"
    yield (
        "maps",
        f"{told.totals.fused}, {told.rates.fused:.2f} per second{latency}, {told.fusion.backlog} waiting",
    )
    if told.fusion.cluster is not None:
        yield "cluster", _cluster(told)
    if told.totals.unconverged or told.fusion.restarts:
        hung = f", {told.fusion.hung} times since it hung" if told.fusion.hung else ""
        yield (
            "",
            f"{told.totals.unconverged} not converged; the fusion was restarted {told.fusion.restarts} "
            f"times{hung}",
        )
    used = told.in_force
    yield (
        "in force",
        f"{used.method}, λ {used.regularization}, β {used.upsampling}, {used.frames} frames over "
        f"{used.span:g} pixels, integration {used.integration_time * 1000:g} ms",
    )
    drops = [f"{count} {cause}" for cause, count in told.drops.model_dump().items() if count]
    yield "dropped", ", ".join(drops) or "nothing"
    yield "recording", _recording(told)
    if told.temperature is not None:
        yield "camera", f"{told.temperature:.1f} °C"
    if told.drift is not None:
        drift = told.drift
        yield (
            "drift",
            f"{drift.distance * 1000:+.1f} ± {drift.deviation * 1000:.1f} mm of what stands still "
            f"({drift.static:.0%}), in {drift.seconds:.0f} s",
        )
    for fault in told.degraded:
        yield "degraded", f"{fault.what}, for {fault.seconds:.0f} s; {fault.remedy}"
    for one in told.subscribers:
        yield (
            "in hand",
            f"{one.topic} of {one.who}: {one.latency:.2f} s after the exposure, {one.slowest:.2f} s at most",
        )
    refused = [f"{count} {code}" for code, count in told.commands.refused.items()]
    yield "commands", f"{told.commands.accepted} carried out, refused: {', '.join(refused) or 'none'}"
    yield "error", "none" if told.error is None else f"{_clock(told.error.timestamp)} {told.error.what}"


def _clock(timestamp: int) -> str:
    return f"{datetime.fromtimestamp(timestamp / 1e9):%Y-%m-%d %H:%M:%S}"


def _cluster(told: "Status") -> str:
    cluster = told.fusion.cluster
    assert cluster is not None
    doing = f"in use, {cluster.workers} workers" if told.fusion.executor == "cluster" else "not in use"
    returned = f", {cluster.returned} bursts of its fused here" if cluster.returned else ""
    return f"{cluster.address}: {doing}, {cluster.fused} maps{returned}"


def _recording(told: "Status") -> str:
    recorder = told.recorder
    if recorder is None:
        return "off"
    if recorder.error is not None:
        return f"nothing: {recorder.error}; {recorder.lost} messages lost"
    if recorder.file is None:
        return "off"
    free = "" if recorder.free is None else f", {recorder.free / 1e9:.1f} GB free"
    doing = "on" if recorder.recording else "off, last"
    lost = f", {recorder.lost} messages lost" if recorder.lost else ""
    return f"{doing}: {recorder.file}, {recorder.size / 1e6:.1f} MB{free}{lost}"
