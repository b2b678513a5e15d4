"""Hostile and clumsy clients: each gets its code or nothing; nothing changes and nobody else notices."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from commanding import Running, configuration, running, stranger
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scripted import ScriptedCamera, ScriptedStage

from drivers.clock import VirtualClock
from service.capture.rig import Rig
from service.daemon.commands import commands
from service.errors import COMMAND_ERRORS, CommandError
from service.messages.events import BurstCaptured, Commanded

pytestmark = pytest.mark.faults

KEY = "lidarboost/rig/cmd/scan"
START = json.dumps({"action": "start"})


class HastyClock(VirtualClock):
    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        time.sleep(max(0.0, seconds) / 20)


@pytest.fixture
def service(tmp_path: Path, endpoint: str) -> Iterator[Running]:
    clock = HastyClock(1_700_000_000_000_000_000)
    with running(
        configuration(tmp_path, endpoint), Rig(ScriptedCamera(clock), ScriptedStage(clock), clock)
    ) as it:
        yield it


def test_only_the_exact_key_with_a_payload_is_carried_out(service: Running, endpoint: str) -> None:
    with stranger(endpoint) as far:
        for key in ("lidarboost/rig/cmd/*", "lidarboost/rig/**", "**", f"{KEY}?_time=[now(-1h)..]"):
            for reply in far.query(key, payload=START, timeout=5):
                if "error" in reply:
                    assert reply["error"]["code"] == "INVALID_ARGUMENT"
                    assert "is not exactly" in reply["error"]["message"]
        seen = {reply["key"] for reply in far.query("**", timeout=5)}
        assert not any(key.startswith("lidarboost/rig/cmd/") for key in seen)
        assert "lidarboost/rig/manifest" in seen
        [reply] = far.query(KEY)
        assert reply["error"] == {
            "code": "INVALID_ARGUMENT",
            "message": f'{KEY} needs a payload, such as {{"action": "get"}}',
        }
        [reply] = far.query(KEY, payload="")
        assert reply["error"]["code"] == "INVALID_ARGUMENT"
        assert far.ask("cmd/settings", action="get")["state"] == "idle"
        assert service.of(Commanded) == []


def test_a_request_of_a_hundred_megabytes_is_refused_and_others_are_served(
    service: Running, endpoint: str
) -> None:
    with stranger(endpoint) as heavy, stranger(endpoint) as light:
        heavy.send(KEY, size=100_000_000, timeout=60)
        for _ in range(20):
            assert light.ask("cmd/settings", action="get")["state"] == "idle"
        [reply] = heavy.replies()
        assert reply["error"] == {
            "code": "INVALID_ARGUMENT",
            "message": "100000000 bytes of payload; at most 1000000 are taken",
        }
        [reply] = light.query(KEY, size=1_000_001)
        assert "1000001 bytes" in reply["error"]["message"]
    assert service.daemon.command_counts().refused == {"INVALID_ARGUMENT": 2}


FLOOD = """
import json, sys, time, zenoh
config = zenoh.Config()
for key, value in {"mode": '"peer"', "listen/endpoints": "[]", "scouting/multicast/enabled": "false",
                   "connect/endpoints": json.dumps([sys.argv[1]])}.items():
    config.insert_json5(key, value)
codes = {}
def note(reply):
    code = "ok" if reply.err is None else json.loads(reply.err.payload.to_bytes()).get("code")
    codes[code] = codes.get(code, 0) + 1
with zenoh.open(config) as session:
    while not list(session.info.peers_zid()):
        time.sleep(0.02)
    began = time.monotonic()
    for _ in range(10_000):
        session.get("lidarboost/rig/cmd/settings", note, payload='{"action": "get"}', timeout=30)
    while sum(codes.values()) < 10_000 and time.monotonic() - began < 40:
        time.sleep(0.02)
    print(json.dumps({"codes": codes, "seconds": time.monotonic() - began}))
"""


def test_a_flood_is_refused_while_the_scan_goes_on_and_can_be_cancelled(
    service: Running, endpoint: str
) -> None:
    with stranger(endpoint) as far:
        far.ask("cmd/scan", action="start")
        flood = subprocess.Popen([sys.executable, "-c", FLOOD, endpoint], stdout=subprocess.PIPE, text=True)
        service.wait(lambda: service.daemon.command_counts().refused.get("UNAVAILABLE", 0) > 100)
        bursts = len(service.of(BurstCaptured))
        service.wait(lambda: len(service.of(BurstCaptured)) > bursts + 1)
        assert far.ask("cmd/scan", action="cancel")["state"] in ("scanning", "idle")
        service.wait_state("idle")
        told = json.loads(flood.communicate(timeout=60)[0])
    assert sum(told["codes"].values()) == 10_000
    assert set(told["codes"]) == {"ok", "UNAVAILABLE"}
    assert told["codes"]["ok"] < 200 + 60 * told["seconds"]


def test_a_client_that_vanishes_harms_nobody(service: Running, endpoint: str) -> None:
    with stranger(endpoint) as gone:
        gone.send(KEY, payload=json.dumps({"action": "once", "map": True}), vanish=True)
        service.wait(lambda: service.daemon.states.state == "scanning")
        gone.process.wait(20)
    with stranger(endpoint) as far:
        assert far.ask("cmd/scan", action="once")["report"]["burst"] == 1
        service.wait_state("idle")
    assert service.daemon.command_counts().accepted == 2


def test_two_who_command_at_once_are_both_answered(service: Running, endpoint: str) -> None:
    with stranger(endpoint) as one, stranger(endpoint) as other:
        for far in (one, other):
            far.send(KEY, payload=json.dumps({"action": "once"}))
        bursts = {far.replies()[0]["ok"]["report"]["burst"] for far in (one, other)}
        assert bursts == {0, 1}
        service.wait_state("idle")
        for far, method in ((one, "bicubic"), (other, "nearest")):
            far.send("lidarboost/rig/cmd/fusion", payload=json.dumps({"action": "set", "method": method}))
        told = {far.replies()[0]["ok"]["fusion"]["method"] for far in (one, other)}
        assert told == {"bicubic", "nearest"}


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=8,
)
NAMES = sorted({field for one in commands().values() for verb in one.verbs for field in verb.model_fields})
ACTIONS = sorted({action for one in commands().values() for action in one.actions})
REQUESTS = st.dictionaries(st.sampled_from(NAMES) | st.text(max_size=8), JSON, max_size=4).flatmap(
    lambda fields: st.sampled_from(ACTIONS).map(lambda action: {**fields, "action": action})
)


@settings(max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(name=st.sampled_from(sorted(commands())), document=REQUESTS | JSON, cut=st.integers(0, 40))
def test_whatever_is_sent_is_a_verb_or_refused_in_one_short_line(
    name: str, document: object, cut: int
) -> None:
    payload = json.dumps(document).encode()
    for sent in (payload, payload[: max(0, len(payload) - cut)], payload[cut:]):
        refused = refusal(name, sent)
        assert refused is None or refused.code in COMMAND_ERRORS
        assert len(str(refused)) < 2000
        assert "\n" not in str(refused)


def refusal(name: str, payload: bytes) -> CommandError | None:
    try:
        commands()[name].read(payload)
    except CommandError as error:
        return error
    return None


@settings(max_examples=200, deadline=None, derandomize=True)
@given(payload=st.binary(max_size=200))
def test_bytes_that_are_no_json_are_refused(payload: bytes) -> None:
    with pytest.raises(CommandError) as caught:
        commands()["cmd/scan"].read(payload)
    assert caught.value.code == "INVALID_ARGUMENT"
