"""The Zenoh files of `deploy/`, in use: a rig, a router and a client of that router."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from publishing import publishing

from drivers.messages import Message, Schema
from service.errors import RemoteError
from service.messages.encoding import fused_messages
from service.messages.map import FusedMap
from service.wire.client import Client
from service.wire.session import open_session

BLOB = Schema("foxglove.RawImage", "protobuf", b"")
DEPLOY = Path(__file__).parents[2] / "deploy"


def wait_until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


def with_endpoint(name: str, old: str, new: str, directory: Path) -> Path:
    text = (DEPLOY / name).read_text(encoding="utf-8")
    assert old in text
    file = directory / name
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def test_a_client_of_the_router_sees_the_rig_under_its_namespace_but_cannot_control_it(
    tmp_path: Path, free_endpoint: Callable[[], str], fused: Callable[[int], FusedMap]
) -> None:
    router_at, rig_at = free_endpoint(), free_endpoint()
    router_file = with_endpoint("zenoh-router.json5", "tcp/0.0.0.0:7447", router_at, tmp_path)
    rig_file = with_endpoint("zenoh-rig.json5", "tcp/127.0.0.1:7448", router_at, tmp_path)
    asked: list[str] = []

    def answer(query: zenoh.Query) -> None:
        with query:
            asked.append(str(query.key_expr))
            query.reply(query.key_expr, b"done")

    with (
        ExitStack() as stack,
        open_session(file=router_file),
        open_session([rig_at], file=rig_file) as session,
        publishing(session) as publisher,
        session.declare_queryable(publisher.key("cmd/scan"), answer),
        Client(router_at, prefix="bench/lidarboost/rig") as distant,
        Client(rig_at, prefix="bench/lidarboost/rig") as near,
    ):
        publisher.publish(fused_messages(fused(3)))
        for client in (distant, near):
            assert client.latest("fused/report", timeout=20).value["burst"] == 3
            assert client.latest("fused/depth").value.shape == (72, 88)
        command = "bench/lidarboost/rig/cmd/scan"
        # Raw frames are thinned out on their way beyond the router.
        seen: dict[str, list[int]] = {"distant": [], "near": []}
        for name, at in (("distant", router_at), ("near", rig_at)):
            watching = stack.enter_context(open_session([], [at], mode="client"))
            key = "bench/lidarboost/rig/camera/distance"
            stack.callback(
                watching.declare_subscriber(key, lambda _, name=name: seen[name].append(1)).undeclare
            )
        for number in range(60):
            publisher.publish([Message("camera/distance", BLOB, b"x", 0, number)])
            time.sleep(0.02)
        wait_until(lambda: len(seen["near"]) >= 40 and bool(seen["distant"]))
        assert len(seen["distant"]) < 20
        # A client has no connection but the router's; a peer on this machine would find the rig itself.
        with open_session([], [router_at], mode="client") as outside:
            assert list(outside.get("bench/lidarboost/rig/fused/report", timeout=5.0))
            assert list(outside.get(command, timeout=1.0)) == []
        assert asked == []
        with open_session([], [rig_at], mode="client") as inside:
            assert len(list(inside.get(command, timeout=5.0))) == 1
        with pytest.raises(RemoteError, match=r"its prefix 'lidarboost/rig'"), Client(router_at) as wrong:
            wrong.latest("fused/report", timeout=1.0)
