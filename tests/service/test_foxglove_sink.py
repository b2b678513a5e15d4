"""The server for Foxglove and Lichtblick, seen by a plain WebSocket client."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("foxglove")
pytest.importorskip("websockets")

from foxglove_client import viewer
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from websockets.exceptions import InvalidHandshake

from drivers.messages import decode_image
from service.config.served import FoxgloveSection
from service.errors import ConfigurationError, OutOfRangeError, OutputError
from service.messages.events import FrameCaptured, MapFused, ReplayTold
from service.messages.map import FusedMap
from service.messages.replay import ReplayState
from service.messages.topics import TOPICS
from service.sinks import foxglove as module
from service.sinks.foxglove import Foxglove

MapMaker = Callable[[int], FusedMap]
BEGIN = 1_700_000_000_000_000_000
LOADED = ReplayState(file="a.mcap", frames=50, duration=10.0, recorded=BEGIN, speed=1.0)


class Commands(list[dict[str, Any]]):
    """Carries out `cmd/replay`."""

    def __init__(self) -> None:
        super().__init__()
        self.state = LOADED

    def __call__(self, request: dict[str, Any]) -> dict[str, Any]:
        self.append(request)
        if request["action"] == "speed" and request["speed"] > 100:
            raise OutOfRangeError("too fast")
        changes = {
            "seek": {"seconds": request.get("seconds")},
            "speed": {"speed": request.get("speed")},
            "play": {"playing": True},
            "pause": {"playing": False},
        }
        self.state = self.state.model_copy(update=changes[request["action"]])
        return {"replay": self.state.model_dump()}


@pytest.fixture
def commands() -> Commands:
    return Commands()


@pytest.fixture
def sink(commands: Commands) -> Iterator[Foxglove]:
    found = Foxglove(FoxgloveSection(enabled=True, port=0), commands)
    found.open()
    yield found
    found.close()


def test_every_topic_is_offered_with_its_schema(sink: Foxglove) -> None:
    with viewer(sink.port) as client:
        while len(client.channels) < len(TOPICS) - 1:
            client.read()
        assert {topic.removeprefix("/") for topic in client.channels} == TOPICS.keys() - {"alive"}
        assert client.channels["/fused/depth"]["schemaName"] == "foxglove.RawImage"
        assert client.channels["/status"]["encoding"] == "json"
        assert "playbackControl" not in client.info["capabilities"]


def test_who_comes_late_gets_the_latest_and_then_what_comes(sink: Foxglove, fused: MapMaker) -> None:
    for number in (1, 2):
        sink.take(MapFused(fused(number), None))
    with viewer(sink.port) as client:
        while len(client.channels) < len(TOPICS) - 1:
            client.read()
        client.subscribe("/fused/depth_mm", "/fused/points", "/fused/transform")
        messages = client.messages()
        late = {topic: (at, payload) for topic, at, payload in (next(messages) for _ in range(3))}
        assert {at for at, _ in late.values()} == {fused(2).frame.timestamp}
        known = np.isfinite(fused(2).depth)
        assert (decode_image(late["/fused/depth_mm"][1]) > 0).sum() == known.sum()
        thinned = np.isfinite(fused(2).depth[2::4, 2::4]).sum()
        assert len(PointCloud.FromString(late["/fused/points"][1]).data) == thinned * 20
        sink.take(MapFused(fused(3), None))
        assert {next(messages)[1] for _ in range(3)} == {fused(3).frame.timestamp}


def test_a_topic_that_does_not_exist_and_nonsense_hurt_nobody(sink: Foxglove, fused: MapMaker) -> None:
    with viewer(sink.port) as client:
        while len(client.channels) < len(TOPICS) - 1:
            client.read()
        client.send({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 99_999}]})
        client.send({"op": "fly"})
        client.connection.send("{")
        client.connection.send(b"\xff\x00")
        client.subscribe("/fused/depth")
        sink.take(MapFused(fused(1), None))
        assert next(client.messages())[0] == "/fused/depth"


def test_an_older_protocol_is_refused(sink: Foxglove) -> None:
    with pytest.raises(InvalidHandshake), viewer(sink.port, "foxglove.websocket.v1"):
        pass


@pytest.mark.slow
def test_a_viewer_that_stalls_holds_nothing_up(sink: Foxglove, fused: MapMaker) -> None:
    with viewer(sink.port) as stalled, viewer(sink.port) as client:
        for one in (stalled, client):
            while len(one.channels) < len(TOPICS) - 1:
                one.read()
            one.subscribe("/fused/depth")
        messages = client.messages()
        began = time.monotonic()
        for number in range(300):
            sink.take(MapFused(fused(number), None))
            if number % 20 == 0:
                next(messages)
        assert time.monotonic() - began < 60
        last = fused(299).frame.timestamp
        assert any(at == last for _, at, _ in messages)


def test_a_replay_is_controlled_from_the_viewer(sink: Foxglove, commands: Commands) -> None:
    sink.take(ReplayTold(LOADED))
    with viewer(sink.port) as client:
        while len(client.channels) < len(TOPICS) - 1:
            client.read()
        assert "playbackControl" in client.info["capabilities"]
        client.control(0, 2.0, BEGIN + 4_000_000_000, "first")
        while not any(state[4] == "first" for state in client.states):
            client.read()
        assert commands == [
            {"action": "seek", "seconds": 4.0},
            {"action": "speed", "speed": 2.0},
            {"action": "play"},
        ]
        assert client.states[-1] == (0, BEGIN + 4_000_000_000, 2.0, True, "first")
        client.control(1, 900.0, None, "refused")
        while not any(state[4] == "refused" for state in client.states):
            client.read()
        assert client.states[-1][2:4] == (2.0, False)
        sink.take(ReplayTold(commands.state.model_copy(update={"seconds": 5.0})))
        while client.states[-1][1] != BEGIN + 5_000_000_000:
            client.read()
    sink.take(ReplayTold(ReplayState()))
    with viewer(sink.port) as client:
        assert "playbackControl" not in client.info["capabilities"]


def test_what_is_not_of_the_sensor_has_the_time_of_the_replay(sink: Foxglove) -> None:
    at = LOADED.model_copy(update={"seconds": 3.0, "timestamp": time.time_ns()})
    sink.take(ReplayTold(LOADED))
    with viewer(sink.port) as client:
        while len(client.channels) < len(TOPICS) - 1:
            client.read()
        client.subscribe("/replay/state")
        next(client.messages())
        sink.take(ReplayTold(at))
        assert next(client.messages())[1] == BEGIN + 3_000_000_000


def test_frames_are_passed_on(sink: Foxglove, fused: MapMaker) -> None:
    with viewer(sink.port) as client:
        while len(client.channels) < len(TOPICS) - 1:
            client.read()
        client.subscribe("/camera/distance")
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            sink.take(FrameCaptured(fused(1).frame, fused(1).calibration.mount))
            try:
                topic, at, _ = next(client.messages(timeout=0.2))
            except TimeoutError:
                continue
            assert (topic, at) == ("/camera/distance", fused(1).frame.timestamp)
            return
        pytest.fail("no frame came")


def test_a_port_that_is_taken_and_a_library_that_is_missing(
    sink: Foxglove, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OutputError, match="set another"):
        Foxglove(FoxgloveSection(enabled=True, port=sink.port), lambda _: {}).open()
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'lidarboost\[foxglove\]'"):
        module._library()
