"""The connections that a rig shall hold: told while they are not there, and when they come back."""

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from service.daemon.network import Network
from service.daemon.states import States
from service.wire.links import Links
from service.wire.session import open_session


def told(network: Network, states: States, *, degraded: bool, seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while True:
        network.look()
        if bool(states.degraded) is degraded:
            return
        assert time.monotonic() < deadline, states.degraded
        time.sleep(0.05)


def zenoh_file(directory: Path, text: str) -> Path:
    file = directory / "zenoh.json5"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_router_that_is_not_there_is_told_until_it_is_back(
    tmp_path: Path, free_endpoint: Callable[[], str], caplog: pytest.LogCaptureFixture
) -> None:
    router_at, other_at = free_endpoint(), free_endpoint()
    file = zenoh_file(
        tmp_path,
        f'{{ listen: {{ endpoints: [] }}, connect: {{ endpoints: ["{router_at}", "{other_at}"] }} }}',
    )
    states = States()
    caplog.set_level(logging.INFO, "service")
    with ExitStack() as stack:
        rig = stack.enter_context(open_session(file=file))
        network = Network(Links(rig, file), states)
        told(network, states, degraded=True)
        (fault,) = states.degraded
        assert fault.what == f"not connected to {router_at}, {other_at}"
        assert "by itself" in fault.remedy
        with open_session([other_at]):
            with open_session([router_at]):
                told(network, states, degraded=False)
            told(network, states, degraded=True)
            assert states.degraded[0].what == f"not connected to {router_at}"
            with open_session([router_at]):
                began = time.monotonic()
                told(network, states, degraded=False)
                assert time.monotonic() - began < 5
    said = [record.getMessage() for record in caplog.records]
    assert f"the connection to {router_at} is not there yet; nobody beyond it is served meanwhile" in said
    assert f"the connection to {router_at} is lost; nobody beyond it is served meanwhile" in said
    assert sum(line.startswith(f"connected to {router_at} after") for line in said) == 2


@pytest.mark.parametrize(
    ("connect", "wanted"),
    [
        ('["tcp/127.0.0.1:1"]', ("tcp/127.0.0.1:1",)),
        (
            '{ peer: [{ strategy: "oneOf", locators: ["tcp/a:1", "tcp/b:2"] }, "tcp/c:3"], router: [] }',
            ("tcp/a:1 or tcp/b:2", "tcp/c:3"),
        ),
        ("[]", ()),
    ],
)
def test_endpoints_are_found_in_every_way_that_zenoh_takes_them(
    tmp_path: Path, connect: str, wanted: tuple[str, ...]
) -> None:
    file = zenoh_file(tmp_path, f"{{ connect: {{ endpoints: {connect} }} }}")
    assert Links(None, file).wanted == wanted  # type: ignore[arg-type]  # nothing is asked of a session


class Link:
    def __init__(self, dst: str, zid: str) -> None:
        self.dst, self.zid = dst, zid


class Session:
    """A session with these links."""

    def __init__(self, *links: Link) -> None:
        self.info = self
        self._links = links

    def links(self) -> tuple[Link, ...]:
        return self._links


def test_an_endpoint_by_name_is_known_by_its_port_and_says_nothing_of_its_keys(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    endpoints = '["tls/router.site:7447#root_ca_certificate_base64=AAAA", "tls/10.0.0.2:7447"]'
    file = zenoh_file(tmp_path, f"{{ connect: {{ endpoints: {endpoints} }} }}")
    states = States()
    caplog.set_level(logging.INFO, "service")
    both = Session(
        Link("tls/10.0.0.2:7447", "b"), Link("tls/10.0.0.1:7447", "a"), Link("tcp/10.0.0.1:7447", "c")
    )
    links = Links(both, file)  # type: ignore[arg-type]
    assert set(links.connected().values()) == {"a", "b"}
    Network(links, states).look()
    assert states.degraded == ()
    only = Links(Session(Link("tls/10.0.0.2:7447", "b")), file)  # type: ignore[arg-type]
    assert only.connected() == {"tls/10.0.0.2:7447": "b"}
    Network(only, states).look()
    assert states.degraded[0].what == "not connected to tls/router.site:7447"
    assert "AAAA" not in caplog.text


def test_a_router_that_was_started_again_between_two_looks_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = zenoh_file(tmp_path, '{ connect: { endpoints: ["tcp/10.0.0.1:7447"] } }')
    session = Session(Link("tcp/10.0.0.1:7447", "before"))
    network = Network(Links(session, file), States())  # type: ignore[arg-type]
    network.look()
    assert caplog.records == []
    session._links = (Link("tcp/10.0.0.1:7447", "after"),)
    network.look()
    network.look()
    assert [record.getMessage() for record in caplog.records] == [
        "tcp/10.0.0.1:7447 was started again; those beyond it connect anew"
    ]
