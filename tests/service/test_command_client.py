"""The client's verbs, its typed errors, and the command line on top of them."""

import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from commanding import Running, configuration, running
from scripted import ScriptedCamera, ScriptedStage
from typer.testing import CliRunner

import lidarboost
from drivers.clock import VirtualClock
from service.capture.rig import Rig
from service.cli import app
from service.errors import InvalidArgumentError, InvalidStateError, OutOfRangeError, RemoteError
from service.messages.events import Commanded
from service.wire.client import Client

pytestmark = pytest.mark.slow


class HastyClock(VirtualClock):
    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        time.sleep(max(0.0, seconds) / 20)


@pytest.fixture
def service(tmp_path: Path, endpoint: str) -> Iterator[Running]:
    clock = HastyClock(1_700_000_000_000_000_000)
    rig = Rig(ScriptedCamera(clock), ScriptedStage(clock), clock)
    with running(configuration(tmp_path, endpoint), rig) as service:
        yield service


def test_the_client_has_the_verbs_and_raises_by_code(service: Running, endpoint: str) -> None:
    with Client(endpoint) as rig:
        answer = rig.scan.once(map=True)
        depth = answer.messages["fused/depth"]
        assert depth.value.shape == (8, 12)
        assert depth.intrinsics is not None
        np.testing.assert_allclose(depth.intrinsics[0, 0], 400.0)
        assert answer["report"]["burst"] == 0
        assert rig.plan.set(span=2.0)["plan"]["span"] == 2.0
        assert rig.fusion.get()["fusion"]["method"] == "nearest"
        assert rig.stage.get()["uncertainty"] is None
        assert rig.stream.start(window=2)["state"] == "streaming"
        with pytest.raises(InvalidStateError, match="streaming: end the stream first"):
            rig.scan.once()
        assert rig.stream.stop()
        service.wait_state("idle")
        with pytest.raises(OutOfRangeError, match="less than or equal to 40"):
            rig.plan.set(span=50)
        with pytest.raises(InvalidArgumentError, match="unknown field 'colour'"):
            rig.plan.set(colour="red")
        with pytest.raises(lidarboost.CommandError, match="one of start, stop, cancel"):
            rig.command("cmd/scan", "leap")
        who = {event.who for event in service.of(Commanded)}
        assert len(who) == 1
        assert "@" in who.pop()


def test_without_a_service_the_client_says_so(endpoint: str) -> None:
    with Client(endpoint) as rig, pytest.raises(RemoteError, match="no service answered at"):
        rig.scan.stop(timeout=0.3)


@pytest.mark.usefixtures("service")
def test_a_command_that_there_is_not_is_said_to_be_none(endpoint: str) -> None:
    with Client(endpoint) as rig:
        with pytest.raises(
            RemoteError, match="cmd/scam: the service has no such command; it has cmd/fusion, "
        ):
            rig.command("cmd/scam", action="once")
        with pytest.raises(InvalidArgumentError, match="unknown field 'name'"):
            rig.command("cmd/scan", action="once", name="of a field")


def test_what_takes_too_long_is_said_to_be_on_its_way(service: Running, endpoint: str) -> None:
    service.daemon.control.inbox.submit(lambda: time.sleep(2), "burst")  # the devices are at work
    with (
        Client(endpoint) as rig,
        pytest.raises(RemoteError, match=r"not done within 0\.5 s; it may be carried"),
    ):
        rig.scan.once(timeout=0.5)


def run(endpoint: str, *arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [*arguments, "--endpoint", endpoint])
    return result.exit_code, result.stdout, result.stderr


def test_the_command_line_has_the_verbs(service: Running, endpoint: str) -> None:
    code, out, err = run(endpoint, "scan", "once")
    assert (code, out.count("\n")) == (0, 1)
    assert out.startswith("burst 0: 4 of 4 frames; 12 × 8 pixels; nearest")
    assert "burst 0: pose 1 of 4" in err
    code, out, _ = run(endpoint, "scan", "once", "--json")
    assert json.loads(out)["report"]["burst"] == 1
    code, out, _ = run(endpoint, "scan", "check")
    assert code == 0
    assert out.startswith("4 poses in about ")
    assert "0.0% saturated, 0.0% dark; noise 0." in out
    code, out, _ = run(endpoint, "plan", "set", "span=2", "axes=pan")
    assert code == 0
    assert "span = 2.0" in out
    assert 'axes = "pan"' in out
    assert "pixels" in out
    code, out, _ = run(endpoint, "fusion", "set", "timeout=50")  # not how long to wait for the answer
    assert (code, "timeout = 50.0" in out) == (0, True)
    code, _, err = run(endpoint, "fusion", "set", "action=get")
    assert (code, "expected FIELD=VALUE" in err) == (2, True)
    code, out, _ = run(endpoint, "fusion", "get", "--json")
    assert json.loads(out)["fusion"]["upsampling"] == 2
    code, out, _ = run(endpoint, "stage", "get")
    assert out.startswith("pan -0.143°")
    assert "limits -57.296° to 57.296°" in out
    code, out, _ = run(endpoint, "stream", "start", "--window", "2")
    assert (code, out) == (0, "streaming: a map for every frame, of the last 2\n")
    code, out, _ = run(endpoint, "stream", "stop")
    assert code == 0
    service.wait_state("idle")


def test_a_refusal_on_the_command_line_is_one_line_and_status_1(service: Running, endpoint: str) -> None:
    for arguments, said in (
        (("scan", "resume"), "there is no scan"),
        (("plan", "set", "span=50"), "less than or equal to 40"),
        (("settings", "set", "integration_time"), "integration_time: expected FIELD=VALUE"),
    ):
        code, out, err = run(endpoint, *arguments)
        assert code in (1, 2)
        assert out == ""
        assert err.count("\n") == 1
        assert said in err
    service.wait(lambda: service.daemon.command_counts().refused == {"INVALID_STATE": 1, "OUT_OF_RANGE": 1})
