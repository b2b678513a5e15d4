"""`lidarboost rigs`: who is alive at the endpoints given, and who disturbs whom."""

import json
from collections.abc import Callable
from contextlib import ExitStack

import pytest
from typer.testing import CliRunner

from service.cli import app
from service.jobs.rigs import FoundRig, warnings_about
from service.messages.encoding import event_messages
from service.messages.events import StatusTold
from service.messages.status import InForce, Status
from service.sinks.publisher import Publisher
from service.wire.session import open_session

Endpoints = Callable[[], str]


def status(model: str, frequency: float, state: str = "scanning") -> Status:
    in_force = InForce(method="area", modulation_frequency=frequency)
    return Status(state=state, reason="bursts by the plan", source="device", model=model, in_force=in_force)


@pytest.fixture
def serving() -> Callable[..., None]:
    with ExitStack() as stack:

        def serve(endpoint: str, prefix: str, told: Status) -> None:
            session = stack.enter_context(open_session(listen=(endpoint,)))
            publisher = Publisher(session, prefix)
            publisher.open()
            stack.callback(publisher.close)
            publisher.publish(event_messages(StatusTold(told)))

        yield serve


def rigs(*words: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["rigs", *map(str, words)])
    return done.exit_code, done.stdout, done.stderr


def test_rigs_are_listed_and_warned_about(free_endpoint: Endpoints, serving: Callable[..., None]) -> None:
    one, other = free_endpoint(), free_endpoint()
    serving(one, "hall/left", status("SR3000", 20e6))
    serving(other, "hall/right", status("SR4000", 20e6, "streaming"))
    done, said, errors = rigs(one, other, "--timeout", 10)
    assert done == 0, errors
    first, second = said.splitlines()
    assert first.split()[:3] == ["hall/left", one, "scanning:"]
    assert "device: SR4000, 20 MHz" in second
    assert "the same modulation frequency of 20 MHz" in errors


def test_an_endpoint_where_nobody_is_and_json(free_endpoint: Endpoints, serving: Callable[..., None]) -> None:
    one, nobody = free_endpoint(), free_endpoint()
    serving(one, "a", status("SR3000", 20e6, "idle"))
    done, said, errors = rigs(one, nobody, "--timeout", 2, "--json")
    found = json.loads(said)
    assert (done, found["silent"], found["warnings"]) == (1, [nobody], [])
    assert found["rigs"][0]["model"] == "SR3000"
    assert f"no service answered at {nobody}" in errors


def rig(prefix: str, frequency: float, state: str = "scanning", source: str = "device") -> FoundRig:
    return FoundRig("tcp/x:1", prefix, state, "", source, "m", None, frequency, ())


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ([rig("b", 20e6)], 1),
        ([rig("b", 21e6)], 0),
        ([rig("b", 20e6, "idle")], 0),
        ([rig("b", 20e6, source="replay")], 0),
        ([rig("b", 0.0)], 0),
        ([rig("a", 21e6)], 1),
        ([rig("b", 20e6), rig("c", 20e6)], 3),
    ],
)
def test_warnings(others: list[FoundRig], said: int) -> None:
    assert len(warnings_about([rig("a", 20e6), *others])) == said
