"""Who may do what at a site with certificates and access rules: the files of `deploy/`, in use."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from secured_site import PREFIX, Site, certificates

from drivers.messages import Message, Schema
from service.errors import RemoteError, SessionError
from service.sinks.publisher import Publisher
from service.wire.client import Client
from service.wire.session import open_session

pytestmark = pytest.mark.slow

REPORT = Schema("lidarboost.BurstReport", "jsonschema", b"")
COMMANDING = ("cmd/scan", "cmd/*", "cmd/**", "*/scan", "**/scan", "**", "*/*")


def wait_until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tls/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return Site(tmp_path_factory.mktemp("site"), free_endpoint())


@pytest.fixture(scope="module")
def asked() -> list[str]:
    """Selectors of what reached the rig's commands."""
    return []


@pytest.fixture(scope="module")
def rig(site: Site, asked: list[str]) -> Iterator[Publisher]:
    with site.router(), site.rig(asked) as publisher:
        publisher.publish([Message("fused/report", REPORT, b'{"burst": 3}', 0, 0)])
        yield publisher


@pytest.fixture
def viewer(site: Site, rig: Publisher) -> Iterator[Client]:  # noqa: ARG001
    with site.person("viewer") as client:
        assert client.latest("fused/report", 20).value == {"burst": 3}
        yield client


@pytest.fixture
def operator(site: Site, rig: Publisher) -> Iterator[Client]:  # noqa: ARG001
    with site.person("operator") as client:
        assert client.latest("fused/report", 20).value == {"burst": 3}
        yield client


def answers(
    client: Client, selector: str, payload: bytes | None = b'{"action": "start"}'
) -> list[zenoh.Reply]:
    return list(client._session.get(f"{PREFIX}/{selector}", payload=payload, timeout=1.0))


def test_a_viewer_reads_what_was_and_what_comes(viewer: Client, rig: Publisher) -> None:
    with viewer.subscribe("fused/report") as reports:
        assert reports.receive(20).value == {"burst": 3}, "late subscribers get the latest"
        rig.publish([Message("fused/report", REPORT, b'{"burst": 3}', 0, 1)])
        assert reports.receive(20).value == {"burst": 3}
    assert list(viewer._session.liveliness().get(f"{PREFIX}/alive", timeout=2.0))


@pytest.mark.parametrize("selector", COMMANDING)
def test_a_viewer_commands_nothing_by_whatever_selector(
    viewer: Client, asked: list[str], selector: str
) -> None:
    asked.clear()
    assert answers(viewer, selector) == []
    assert asked == []


def test_an_operator_commands(operator: Client, asked: list[str]) -> None:
    asked.clear()
    assert operator.scan.start(20) == {"state": "idle"}
    assert asked == [f"{PREFIX}/cmd/scan".removeprefix("bench/")]
    # What names no command reaches none: nobody commands all at once.
    assert answers(operator, "**") == []


@pytest.mark.parametrize("who", ["viewer", "operator", "stranger"])
def test_nobody_passes_for_the_rig(
    site: Site, rig: Publisher, viewer: Client, asked: list[str], who: str
) -> None:
    heard: list[str] = []

    def hear(sample: zenoh.Sample) -> None:
        heard.append(sample.payload.to_string())

    def answer(query: zenoh.Query) -> None:
        with query:
            asked.append("impostor")

    asked.clear()
    with ExitStack() as stack:
        file = site.file("zenoh-secure-client.json5", who)
        impostor = stack.enter_context(open_session([], [], file))
        listening = viewer._session.declare_subscriber(f"{PREFIX}/**", hear)
        tokens = viewer._session.liveliness().declare_subscriber(f"{PREFIX}/**", hear)
        stack.callback(listening.undeclare)
        stack.callback(tokens.undeclare)
        for key in ("fused/report", "status", "cmd/scan", "alive"):
            impostor.put(f"{PREFIX}/{key}", "forged")
            impostor.delete(f"{PREFIX}/{key}")
        for key in ("cmd/scan", "fused/report", "manifest", "**"):
            stack.callback(impostor.declare_queryable(f"{PREFIX}/{key}", answer, complete=True).undeclare)
        stack.enter_context(impostor.liveliness().declare_token(f"{PREFIX}/alive"))
        stack.enter_context(impostor.liveliness().declare_token(f"{PREFIX}/forged"))
        time.sleep(0.5)  # what would arrive has arrived: what follows comes the same way
        rig.publish([Message("fused/report", REPORT, b'{"burst": 3}', 0, 2)])
        wait_until(lambda: '{"burst": 3}' in heard)
        assert viewer.latest("fused/report").value == {"burst": 3}
        with site.person("operator") as boss:
            assert boss.scan.start(20) == {"state": "idle"}
        assert set(heard) == {'{"burst": 3}'}
        assert asked == ["lidarboost/rig/cmd/scan"]


def test_a_certificate_that_is_in_no_list_opens_nothing(site: Site, rig: Publisher, asked: list[str]) -> None:
    asked.clear()
    with site.person("stranger") as client:
        wait_until(lambda: bool(client._session.info.routers_zid()))
        with client.subscribe("fused/report") as reports:
            rig.publish([Message("fused/report", REPORT, b'{"burst": 3}', 0, 3)])
            with pytest.raises(RemoteError):
                reports.receive(1.0)
        for selector in ("fused/report", "status", "manifest", *COMMANDING):
            assert answers(client, selector) == []
    assert asked == []


@pytest.mark.parametrize("kind", ["another authority", "no certificate", "no TLS"])
def test_who_has_no_certificate_of_the_site_is_not_let_in(
    site: Site,
    rig: Publisher,  # noqa: ARG001
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
) -> None:
    if kind == "another authority":
        other = certificates(tmp_path_factory.mktemp("other"), "viewer")
        (other / "authority.pem").write_bytes((site.tls / "authority.pem").read_bytes())
        file = site.file("zenoh-secure-client.json5", "viewer", other)
    elif kind == "no certificate":
        file = site.file("zenoh-secure-client.json5", "nobody")
        lines = file.read_text(encoding="utf-8").splitlines()
        bare = [line for line in lines if "nobody." not in line and "enable_mtls" not in line]
        file.write_text("\n".join(bare), encoding="utf-8")
    else:
        file = site.folder / "plain.json5"
        file.write_text(
            f'{{ mode: "client", connect: {{ endpoints: ["{site.endpoint.replace("tls/", "tcp/")}"] }} }}'
        )
    try:
        with open_session([], [], file) as session:
            assert not list(session.get(f"{PREFIX}/fused/report", timeout=1.0))
            assert not list(session.info.routers_zid())
    except SessionError:
        pass


def test_receipts_of_viewers_reach_the_rig(viewer: Client, rig: Publisher) -> None:
    rig._receipts.expect(5, time.monotonic() - 2.0)  # type: ignore[union-attr]
    text = '{"who": "anna", "topic": "fused/depth", "timestamp": 5}'
    viewer._session.put(f"{PREFIX}/receipt/anna", text)
    wait_until(lambda: bool(rig.subscribers))
    assert rig.subscribers[0].latency > 2.0


def test_a_rig_may_stand_without_a_router(site: Site, tmp_path: Path) -> None:
    alone = Site(tmp_path, free_endpoint(), site.tls)
    asked: list[str] = []
    with alone.router() as session, ExitStack() as stack:
        publisher = Publisher(session, PREFIX)
        publisher.open()
        stack.callback(publisher.close)

        def answer(query: zenoh.Query) -> None:
            with query:
                asked.append(str(query.selector))
                query.reply(query.key_expr, b"{}", encoding=zenoh.Encoding.APPLICATION_JSON)

        stack.callback(session.declare_queryable(f"{PREFIX}/cmd/scan", answer).undeclare)
        publisher.publish([Message("fused/report", REPORT, b'{"burst": 4}', 0, 0)])
        with alone.person("viewer") as client:
            assert client.latest("fused/report", 20).value == {"burst": 4}
            for selector in COMMANDING:
                assert answers(client, selector) == []
        assert asked == []
        with alone.person("operator") as client:
            assert client.scan.start(20) == {}
        assert asked == [f"{PREFIX}/cmd/scan"]
