import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from publishing import publishing
from typer.testing import CliRunner

from service.cli import app
from service.cli.status import _lines
from service.messages.events import MapFused, StatusTold
from service.messages.map import FusedMap
from service.messages.status import (
    ClusterState,
    CommandCounts,
    Degraded,
    Drops,
    FusionState,
    InForce,
    LastError,
    Rates,
    RecorderState,
    SinkState,
    Status,
    Totals,
)
from service.sinks.publisher import Publisher
from service.wire.session import open_session

STATUS = Status(
    timestamp=1_700_000_000_000_000_000,
    version="0.1.0",
    state="scanning",
    reason="bursts by the plan",
    seconds=7.0,
    degraded=(Degraded(what="recorder: the disk is full", remedy="make room", seconds=5.0),),
    source="simulation",
    model="simulated SR3000",
    serial=None,
    uptime=12.0,
    totals=Totals(frames=45, bursts=3, fused=2, unconverged=2),
    rates=Rates(frames=7.5, fused=0.5),
    drops=Drops(camera=4, recorded=2),
    fusion=FusionState(
        executor="cluster",
        cluster=ClusterState(address="tcp://10.0.0.7:8786", workers=2, fused=1, returned=1),
        backlog=1,
        restarts=1,
        hung=0,
        error=None,
    ),
    latency=0.42,
    recorder=RecorderState(
        recording=True,
        file="a.mcap",
        size=3_000_000,
        messages=9,
        free=5_000_000_000,
    ),
    sinks=(
        SinkState(
            name="recorder",
            state="restarting",
            waiting=1,
            taken=9,
            dropped=2,
            faults=1,
            abandoned=0,
            error="the disk is full",
        ),
    ),
    commands=CommandCounts(accepted=7, refused={"OUT_OF_RANGE": 2}),
    in_force=InForce(
        method="phasor",
        upsampling=4,
        regularization="auto",
        frames=15,
        window=15,
        span=1.0,
        integration_time=0.03,
    ),
    error=LastError(what="the cable is loose", timestamp=1_700_000_000_000_000_000),
)


@pytest.fixture
def service(endpoint: str, fused: Callable[[int], FusedMap]) -> Iterator[str]:
    """A service that has published one map and its status."""
    with open_session([endpoint]) as session, publishing(session) as publisher:
        result = fused(6)
        publisher.take(MapFused(result, None))
        publisher.take(StatusTold(STATUS))
        assert publisher.drain()
        yield endpoint


def run(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.stdout, result.stderr


def test_status_says_what_matters(service: str) -> None:
    code, out, _ = run("status", "--endpoint", service)
    assert code == 0
    for expected in (
        "scanning for 7 s: bursts by the plan",
        "up 12 s",
        "recorder: the disk is full, for 5 s; make room",
        "simulation: simulated SR3000",
        "45, 3 whole bursts, 7.5 per second",
        "maps       2, 0.50 per second, 0.42 s after the last frame, 1 waiting",
        "4 camera, 2 recorded",
        "on: a.mcap, 3.0 MB, 5.0 GB free",
        "phasor, λ auto, β 4, 15 frames over 1 pixels, integration 30 ms",
        "7 carried out, refused: 2 OUT_OF_RANGE",
        "tcp://10.0.0.7:8786: in use, 2 workers, 1 maps, 1 bursts of its fused here",
        "2 not converged; the fusion was restarted 1 times",
        " the cable is loose",
    ):
        assert expected in out
    assert Status.model_validate_json(run("status", "--endpoint", service, "--json")[1]) == STATUS


def test_status_of_a_stream_and_of_another_version(endpoint: str) -> None:
    with open_session([endpoint]) as session, publishing(session) as publisher:
        publisher.take(StatusTold(Status(state="streaming", seconds=7.0, totals=Totals(frames=9, fused=8))))
        assert publisher.drain()
        _, out, _ = run("status", "--endpoint", endpoint)
    assert "state      streaming for 7 s\n" in out
    assert "maps       8, 0.00 per second" in out


def test_a_pause_does_not_pass_for_as_old_as_the_scan() -> None:
    told = dict(_lines(STATUS.model_copy(update={"paused": True})))
    assert told["state"] == "scanning for 7 s, paused: bursts by the plan"


def test_get_shows_and_saves_every_kind(
    service: str, tmp_path: Path, fused: Callable[[int], FusedMap]
) -> None:
    result = fused(6)
    code, out, _ = run("get", "fused/depth", "--endpoint", service)
    assert code == 0
    assert "88 × 72 float32" in out
    assert "fx 400, fy 400, cx 43.5, cy 35.5 pixels" in out
    assert json.loads(run("get", "fused/report", "--endpoint", service)[1])["burst"] == 6
    for name, topic in (("d.npy", "fused/depth"), ("d.npz", "fused/depth"), ("p.ply", "fused/points")):
        code, out, err = run("get", topic, "--endpoint", service, "-o", str(tmp_path / name))
        assert (code, err) == (0, "")
        assert f"wrote {tmp_path / name}" in out
    np.testing.assert_array_equal(np.load(tmp_path / "d.npy"), result.depth)
    with np.load(tmp_path / "d.npz") as saved:
        np.testing.assert_allclose(saved["intrinsics"], result.intrinsics)
        assert saved["timestamp"] == result.frame.timestamp
    header, _, data = (tmp_path / "p.ply").read_bytes().partition(b"end_header\n")
    count = int(np.isfinite(result.depth).sum())
    assert f"element vertex {count}\n".encode() in header
    points = np.frombuffer(data, "<f4").reshape(count, 5)
    np.testing.assert_allclose(points[:, 2], result.depth[np.isfinite(result.depth)], rtol=1e-6)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d.npy", "d.npz", "p.ply"]


def test_watch_prints_a_line_a_message(service: str) -> None:
    code, out, _ = run("watch", "fused/depth", "--count", "1", "--endpoint", service)
    assert code == 0
    assert out.startswith("22:13:26.123 fused/depth 88 × 72 float32, ")
    out = run("watch", "--count", "1", "--endpoint", service)[1]
    assert "burst 6: 3 of 3 frames; 88 × 72 pixels; nearest; median deviation" in out
    out = run("watch", "--json", "--count", "1", "--endpoint", service)[1]
    assert json.loads(out)["burst"] == 6


def test_of_two_rigs_the_one_that_is_named_is_shown(
    endpoint: str, free_endpoint: Callable[[], str], fused: Callable[[int], FusedMap]
) -> None:
    """Both are reached at one endpoint."""
    with ExitStack() as stack:
        for number, prefix in enumerate(("hall/left", "hall/right")):
            here = endpoint if number == 0 else free_endpoint()
            session = stack.enter_context(open_session([here], connect=[endpoint] if number else []))
            publisher = Publisher(session, prefix)
            publisher.open()
            stack.callback(publisher.close)
            publisher.take(MapFused(fused(number + 3), None))
            publisher.take(StatusTold(STATUS.model_copy(update={"model": prefix})))
            assert publisher.drain()
        for number, prefix in enumerate(("hall/left", "hall/right")):
            told = ("--endpoint", endpoint, "--prefix", prefix)
            assert f"burst {number + 3}: " in run("watch", "--count", "1", *told)[1]
            assert f"simulation: {prefix}" in run("status", *told)[1]
            assert json.loads(run("get", "fused/report", *told)[1])["burst"] == number + 3


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (("get", "fused/dept"), 1, "no topic is called 'fused/dept'"),
        (("get", "fused/depth", "-o", "a.jpg"), 2, "expected one of .npy, .npz, .ply, .json"),
        (("get", "fused/report", "-o", "a.npy"), 2, "neither image nor points"),
        (("get", "fused/depth", "-o", "a.ply"), 2, "holds no points"),
        (("get", "fused/depth", "-o", "/nowhere/a.npy"), 1, "cannot be written"),
        (("status", "--prefix", ""), 1, "the prefix '' is no key; expected one like lidarboost/rig"),
    ],
)
def test_what_cannot_be_done_is_one_clear_line(
    service: str, arguments: tuple[str, ...], code: int, expected: str
) -> None:
    status, out, err = run(*arguments, "--endpoint", service)
    assert (status, out) == (code, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert expected in err


def test_without_a_service_it_says_where_it_looked(endpoint: str) -> None:
    status, _, err = run("status", "--endpoint", endpoint, "--timeout", "0.2")
    assert status == 1
    assert f"no service answered at {endpoint}" in err


@pytest.mark.parametrize(
    ("recorder", "said"),
    [
        (RecorderState(error="the disk is full", lost=7), "nothing: the disk is full; 7 messages lost"),
        (RecorderState(recording=True, file="a.mcap", lost=7), "on: a.mcap, 0.0 MB, 7 messages lost"),
        (RecorderState(), "off"),
        (None, "off"),
    ],
)
def test_status_says_whether_anything_is_recorded(recorder: RecorderState | None, said: str) -> None:
    lines = dict(_lines(STATUS.model_copy(update={"recorder": recorder})))
    assert lines["recording"] == said
