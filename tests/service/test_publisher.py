"""The publisher, seen by subscribers in processes of their own (`listener.py`)."""

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from publishing import publishing

from drivers.messages import Message, Schema
from service.errors import SessionError
from service.messages import viewing
from service.messages.encoding import fused_messages
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.wire.addresses import DEFAULT_PREFIX
from service.wire.session import _configuration, open_session

LISTENER = Path(__file__).with_name("listener.py")
BLOB = Schema("foxglove.Log", "protobuf", b"")


@contextmanager
def listener(session: zenoh.Session, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """A subscriber in another process, known to be subscribed."""
    with listening(*arguments) as process:
        wait_until(lambda: bool(list(session.liveliness().get("test/listening"))))
        yield process


@contextmanager
def listening(*arguments: str) -> Iterator["subprocess.Popen[str]"]:
    with subprocess.Popen(
        [sys.executable, str(LISTENER), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.005)


def told(process: "subprocess.Popen[str]") -> dict[str, dict[str, Any]]:
    out, err = process.communicate(timeout=30)
    assert err == ""
    rows = [json.loads(line) for line in out.splitlines()]
    return {row["key"].removeprefix(DEFAULT_PREFIX + "/"): row for row in rows}


def hashes(messages: list[Message]) -> dict[str, str]:
    return {message.topic: hashlib.sha256(message.payload).hexdigest() for message in messages}


def test_a_subscriber_in_another_process_receives_and_decodes_a_fused_map(
    endpoint: str, fused: Callable[[int], FusedMap]
) -> None:
    result = fused(1)
    sent = fused_messages(result)
    with (
        open_session([endpoint]) as session,
        publishing(session) as publisher,
        listener(session, endpoint, DEFAULT_PREFIX, str(len(sent))) as process,
    ):
        publisher.publish(sent)
        got = told(process)
    assert {topic: row["sha256"] for topic, row in got.items()} == hashes(sent)
    depth = got["fused/depth"]
    assert depth["encoding"] == "application/protobuf;foxglove.RawImage"
    assert (depth["shape"], depth["frame_id"]) == ([72, 88], "fused")
    assert depth["timestamp"] == result.frame.timestamp
    assert depth["mean"] == pytest.approx(float(np.nanmean(result.depth)), abs=1e-6)
    assert got["fused/calibration"]["shape"] == [72, 88]
    assert got["fused/calibration"]["K"] == pytest.approx(result.intrinsics.ravel().tolist())
    assert got["fused/report"]["encoding"] == "application/json;lidarboost.BurstReport"
    assert got["fused/report"]["json"]["burst"] == 1


def test_late_subscribers_and_queries_receive_the_latest(
    endpoint: str, fused: Callable[[int], FusedMap]
) -> None:
    sent = [fused_messages(fused(number)) for number in (1, 2, 3)]
    with open_session([endpoint]) as session, publishing(session) as publisher:
        for messages in sent:
            publisher.publish(messages)
        assert publisher.drain()
        with listening(endpoint, DEFAULT_PREFIX, str(len(sent[-1])), "--advanced") as late:
            assert {topic: row["sha256"] for topic, row in told(late).items()} == hashes(sent[-1])
        with listening(endpoint, DEFAULT_PREFIX, "1", "--get", "fused/*") as query:
            assert {topic: row["sha256"] for topic, row in told(query).items()} == hashes(sent[-1])


def test_points_are_made_only_when_somebody_wants_them(
    endpoint: str, fused: Callable[[int], FusedMap], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    make = viewing.points_message

    def counted(result: FusedMap) -> Message:
        made.append(result.report.burst)
        return make(result)

    monkeypatch.setattr(viewing, "points_message", counted)
    with open_session([endpoint]) as session, publishing(session) as publisher:
        publisher.take(MapFused(fused(1), None))
        assert publisher.drain()
        assert made == []
        for _ in range(2):
            with listening(endpoint, DEFAULT_PREFIX, "1", "--get", "fused/points") as query:
                answer = told(query)["fused/points"]
        assert made == [1]
        assert answer["fields"] == ["x", "y", "z", "amplitude", "deviation"]
        assert answer["points"] == int(np.isfinite(fused(1).depth).sum())
        with listener(session, endpoint, f"{DEFAULT_PREFIX}/fused/points", "1") as process:
            publisher.take(MapFused(fused(2), None))
            (row,) = told(process).values()
            assert row["timestamp"] == fused(2).frame.timestamp
        assert made == [1, 2]


@contextmanager
def stopped_reader(session: zenoh.Session, endpoint: str, count: int) -> Iterator["subprocess.Popen[str]"]:
    """A subscriber in another process, stopped as with Ctrl-Z; it prints the first byte of what it gets."""
    script = [sys.executable, "-c", READER, endpoint, str(count)]
    with subprocess.Popen(script, stdout=subprocess.PIPE, text=True) as process:
        try:
            wait_until(lambda: bool(list(session.liveliness().get("test/reading"))))
            os.kill(process.pid, signal.SIGSTOP)
            yield process
        finally:
            process.kill()


READER = """
import json, queue, sys, zenoh
config = zenoh.Config()
for key, value in {"mode": '"peer"', "listen/endpoints": "[]", "scouting/multicast/enabled": "false",
                   "connect/endpoints": json.dumps([sys.argv[1]]),
                   "connect/retry": "{period_init_ms: 50, period_max_ms: 100}"}.items():
    config.insert_json5(key, value)
received = queue.Queue()
with zenoh.open(config) as session:
    with session.declare_subscriber("lidarboost/rig/**", received.put), \\
         session.liveliness().declare_token("test/reading"):
        for _ in range(int(sys.argv[2])):
            print(received.get(timeout=5).payload.to_bytes()[0], flush=True)
"""


@pytest.mark.parametrize(("shared_memory", "pause"), [(True, 3.0), (False, 0.5)])
def test_closing_waits_for_a_subscriber_that_reads_late(
    endpoint: str, tmp_path: Path, shared_memory: bool, pause: float
) -> None:
    """With shared memory and a pause of 3 s, closing without `drain` loses all (of 2 s: nothing)."""
    file = tmp_path / "zenoh.json5"
    file.write_text(f"{{ transport: {{ shared_memory: {{ enabled: {str(shared_memory).lower()} }} }} }}")
    sent = [Message("fused/depth", BLOB, bytes([number]) * 1_600_000, 0, number) for number in range(4)]
    with ExitStack() as stack:
        session = stack.enter_context(open_session([endpoint], file=file))
        publisher = stack.enter_context(publishing(session, lossless=True))
        reader = stack.enter_context(stopped_reader(session, endpoint, len(sent)))
        publisher.publish(sent)
        assert not publisher.drain(timeout=0.2)
        resume = threading.Timer(pause, os.kill, (reader.pid, signal.SIGCONT))
        resume.start()
        publisher.close()
        session.close()  # type: ignore[no-untyped-call]
        resume.join()
        assert publisher.losses == ()
        assert reader.stdout is not None
        assert [int(line) for line in reader.stdout] == [0, 1, 2, 3]


def test_a_stuck_subscriber_holds_up_neither_live_publishing_nor_others(
    endpoint: str, fused: Callable[[int], FusedMap]
) -> None:
    raw = [Message("camera/distance", BLOB, bytes(50_688), 0, number) for number in range(300)]
    maps = fused_messages(fused(1))
    prefix = f"{DEFAULT_PREFIX}/fused"
    with ExitStack() as stack:
        session = stack.enter_context(open_session([endpoint]))
        publisher = stack.enter_context(publishing(session))
        healthy = stack.enter_context(listener(session, endpoint, prefix, str(len(maps))))
        stack.enter_context(stopped_reader(session, endpoint, 1))
        began = time.monotonic()
        publisher.publish(raw)
        assert time.monotonic() - began < 1.0
        publisher.publish(maps)
        assert {row["sha256"] for row in told(healthy).values()} == set(hashes(maps).values())


def test_the_service_is_alive_while_the_publisher_is(endpoint: str) -> None:
    with open_session([endpoint]) as session, open_session([], [endpoint]) as other:
        key = f"{DEFAULT_PREFIX}/alive"
        with publishing(session):
            wait_until(lambda: bool(list(other.liveliness().get(key))))
        wait_until(lambda: not list(other.liveliness().get(key)))


def test_a_port_in_use_is_one_clear_error_that_names_who_has_it() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        message = rf"{endpoint} is in use by process {os.getpid()} \(.*stop it"
        with pytest.raises(SessionError, match=message), open_session([endpoint]):
            pass


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{ mode: ", "not a Zenoh configuration"),
        ("{ colour: 1 }", "unknown field `colour`"),
        (None, "No such file"),
    ],
)
def test_a_zenoh_file_that_cannot_be_used_is_named(tmp_path: Path, text: str | None, expected: str) -> None:
    file = tmp_path / "zenoh.json5"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SessionError, match=expected) as caught, open_session(file=file):
        pass
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_the_zenoh_file_sets_goes_before_our_own(tmp_path: Path, endpoint: str) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(f'{{ mode: "router", listen: {{ endpoints: ["{endpoint}"] }} }}')
    with open_session(file=file), open_session([], [endpoint], mode="client") as client:
        wait_until(lambda: bool(client.info.routers_zid()))


DEFAULTS = {
    "transport/link/tx/queue/size/data": "2",
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": "50000",
    "listen/endpoints": '["tcp/127.0.0.1:0"]',
    "connect/endpoints": "[]",
    "scouting/multicast/enabled": "true",
    "mode": '"peer"',
}
"""Of Zenoh."""


@pytest.mark.parametrize("key", DEFAULTS)
def test_what_the_zenoh_file_sets_goes_before_our_own_even_where_it_is_a_default(
    tmp_path: Path, key: str
) -> None:
    file, (*above, last) = tmp_path / "zenoh.json5", key.split("/")
    nested = f"{last}: {DEFAULTS[key]}, // as it is\n"
    for name in reversed(above):
        nested = f"{name}: {{ {nested} }},"
    file.write_text(f"\ufeff{{ {nested} }}", encoding="utf-8")
    ours = _configuration(["tcp/127.0.0.1:7447"], ["tcp/127.0.0.1:7448"], None, "client")
    found = _configuration(["tcp/127.0.0.1:7447"], ["tcp/127.0.0.1:7448"], file, "client")
    for name in DEFAULTS:
        wanted = json.loads(DEFAULTS[key]) if name == key else json.loads(ours.get_json(name))
        assert json.loads(found.get_json(name)) == wanted


def test_a_zenoh_file_in_yaml_goes_before_our_own(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.yaml"
    file.write_text("mode: router\n")
    found = _configuration(["tcp/127.0.0.1:7447"], [], file, "peer")
    assert json.loads(found.get_json("mode")) == "router"
    assert json.loads(found.get_json("listen/endpoints")) == ["tcp/127.0.0.1:7447"]


@pytest.mark.parametrize("endpoint", ["nonsense", "carrier-pigeon/127.0.0.1:7447", "tcp/127.0.0.1:99999"])
def test_an_endpoint_that_is_none_is_refused(endpoint: str) -> None:
    with pytest.raises(SessionError, match=endpoint), open_session([endpoint]):
        pass
