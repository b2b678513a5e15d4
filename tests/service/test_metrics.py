"""Metrics and health by HTTP, as a monitor asks for them."""

import http.client
import json
import re
import socket
import sys
from collections.abc import Iterator

import pytest

from service.errors import ConfigurationError, OutputError
from service.messages.events import StatusTold
from service.messages.status import (
    ClusterState,
    CommandCounts,
    Drops,
    FusionState,
    InForce,
    SinkState,
    Status,
    Subscriber,
    Totals,
)
from service.sinks.metrics import Metrics


class Served:
    """A sink that is open, and its clock."""

    def __init__(self) -> None:
        self.now = 100.0
        self.sink = Metrics(Metrics.Options(port=0), clock=lambda: self.now)
        self.sink.open()

    def tell(self, **fields: object) -> None:
        self.sink.take(StatusTold(Status.model_validate({"state": "scanning", **fields})))

    def get(self, path: str, host: str | None = None, method: str = "GET") -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.sink.port, timeout=10)
        try:
            connection.request(method, path, headers={} if host is None else {"Host": host})
            answer = connection.getresponse()
            return answer.status, answer.read().decode()
        finally:
            connection.close()

    def ready(self) -> str:
        """Why not; nothing where it is."""
        status, body = self.get("/readyz")
        told = json.loads(body)
        assert (status == 200) is told["ok"] is (told["why"] == "")
        return str(told["why"])


@pytest.fixture
def served() -> Iterator[Served]:
    one = Served()
    yield one
    one.sink.close()


def test_the_status_is_there_as_metrics(served: Served) -> None:
    served.tell(
        version="1.2",
        totals=Totals(frames=500, fused=33),
        drops=Drops(camera=7),
        latency=0.25,
        fusion=FusionState(executor="cluster", cluster=ClusterState(workers=2, fused=30, returned=1)),
        sinks=(SinkState(name="publisher", taken=4, dropped=3),),
        subscribers=(Subscriber(who='ann"\n@x', topic="fused/depth", latency=0.5),),
        commands=CommandCounts(accepted=2, refused={"NOT_FOUND": 4}),
    )
    status, text = served.get("/metrics")
    assert status == 200
    for line in (
        'lidarboost_build_info{version="1.2"} 1.0',
        'lidarboost_state{state="scanning"} 1.0',
        'lidarboost_state{state="idle"} 0.0',
        "lidarboost_frames_total 500.0",
        "lidarboost_maps_total 33.0",
        'lidarboost_dropped_total{cause="camera"} 7.0',
        "lidarboost_latency_seconds 0.25",
        "lidarboost_cluster_workers 2.0",
        "lidarboost_cluster_maps_total 30.0",
        "lidarboost_cluster_returned_total 1.0",
        'lidarboost_sink_dropped_total{sink="publisher"} 3.0',
        'lidarboost_sink_running{sink="publisher"} 1.0',
        'lidarboost_subscriber_latency_seconds{topic="fused/depth",who="ann\\"\\n@x"} 0.5',
        'lidarboost_commands_refused_total{code="NOT_FOUND"} 4.0',
        "lidarboost_recording 0.0",
    ):
        assert line in text.splitlines(), line
    assert re.search(r"^process_open_fds \d", text, re.M)


def test_every_count_of_the_status_is_a_metric(served: Served) -> None:
    served.tell()
    text = served.get("/metrics")[1]
    for cause in Drops.model_fields:
        assert f'cause="{cause}"' in text


def test_it_is_alive_as_long_as_the_status_is_told(served: Served) -> None:
    assert served.get("/healthz")[0] == 200, "it starts"
    served.now += 9
    assert served.get("/healthz")[0] == 200
    served.now += 2
    assert served.get("/healthz") == (
        503,
        '{"ok": false, "why": "no status for 11 s", "state": "starting"}\n',
    )
    served.tell(state="recovering")
    assert served.get("/healthz")[0] == 200, "a lost camera is no reason to kill it"


def test_it_is_ready_where_frames_come_or_none_shall(served: Served) -> None:
    assert served.ready() == "it starts"
    for state in ("starting", "recovering", "stopping"):
        served.tell(state=state, reason="so")
        assert served.ready() == f"{state}: so"
    served.tell(state="idle")
    assert served.ready() == ""

    def scan(seconds: float, **fields: object) -> None:
        for _ in range(int(seconds / 5)):
            served.now += 5
            served.tell(**fields)

    served.tell(totals=Totals(frames=1))
    scan(50, totals=Totals(frames=1))
    assert served.ready() == ""
    scan(15, totals=Totals(frames=1))
    assert served.ready() == "scanning, but no frame for 65 s"
    assert served.get("/healthz")[0] == 200
    served.tell(totals=Totals(frames=1), in_force=InForce(pause=3600))
    assert served.ready() == "", "the next burst is an hour away"
    served.tell(totals=Totals(frames=1), paused=True)
    assert served.ready() == ""
    served.tell(totals=Totals(frames=2))
    assert served.ready() == ""


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:9464", "127.0.0.1.evil.example", "", "[::1]@x"]
)
def test_a_page_of_elsewhere_reads_nothing(served: Served, host: str) -> None:
    served.tell(version="secret")
    for path in ("/metrics", "/healthz", "/readyz"):
        status, body = served.get(path, host)
        assert status == 403
        assert "secret" not in body


def test_both_names_of_this_machine_will_do_and_nothing_else_is_served(served: Served) -> None:
    for host in ("localhost", f"localhost:{served.sink.port}", f"127.0.0.1:{served.sink.port}"):
        assert served.get("/healthz", host)[0] == 200
    assert served.get("/healthz", method="HEAD") == (200, "")
    assert served.get("/../../etc/passwd")[0] == 404
    assert served.get("/metrics", method="POST")[0] == 501


def test_it_listens_on_loopback_alone(served: Served) -> None:
    assert served.sink._server.server_address[0] == "127.0.0.1"


def test_a_port_in_use_is_told_with_who_has_it(served: Served) -> None:
    with pytest.raises(OutputError, match=rf"{served.sink.port} is in use by process .*metrics\.port"):
        Metrics(Metrics.Options(port=served.sink.port)).open()


def test_a_request_that_never_ends_holds_nobody_up(served: Served) -> None:
    with socket.create_connection(("127.0.0.1", served.sink.port)) as slow:
        slow.sendall(b"GET /healthz HTTP/1.1\r\nHo")
        assert served.get("/healthz")[0] == 200


def test_without_the_library_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'lidarboost\[metrics\]'"):
        Metrics(Metrics.Options(port=0)).open()
