"""A plain WebSocket client that speaks Foxglove's protocol."""

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from websockets.sync.client import ClientConnection, connect

PROTOCOL = "foxglove.sdk.v1"


class Viewer:
    """What a viewer knows.

    Attributes:
        info: what the server said of itself.
        channels: number by topic.
        encodings: of messages by topic.
        states: playback states as they came: status, time, speed, whether it sought, request.
    """

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.states: list[tuple[int, int, float, bool, str]] = []
        self._topics: dict[int, str] = {}
        while not self.channels:
            self.read()

    def subscribe(self, *topics: str) -> None:
        subscriptions = []
        for topic in topics:
            number = len(self._topics) + 1
            self._topics[number] = topic
            subscriptions.append({"id": number, "channelId": self.channels[topic]["id"]})
        self.send({"op": "subscribe", "subscriptions": subscriptions})

    def send(self, message: dict[str, Any]) -> None:
        self.connection.send(json.dumps(message))

    def control(self, command: int, speed: float, seek: int | None, request: str) -> None:
        """Ask for playback: 0 play, 1 pause."""
        name = request.encode()
        head = struct.pack("<BBfBQI", 3, command, speed, seek is not None, seek or 0, len(name))
        self.connection.send(head + name)

    def read(self, timeout: float = 20.0) -> tuple[str, int, bytes] | None:
        """The next message as (topic, log time, payload); None for whatever else comes."""
        got = self.connection.recv(timeout)
        if isinstance(got, str):
            said = json.loads(got)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in said["channels"]}
            return None
        if got[0] == 1:
            number, at = struct.unpack_from("<IQ", got, 1)
            return self._topics[number], at, got[13:]
        if got[0] == 5:
            status, at, speed, sought, length = struct.unpack_from("<BQfBI", got, 1)
            self.states.append((status, at, speed, bool(sought), got[19 : 19 + length].decode()))
        return None

    def messages(self, timeout: float = 20.0) -> Iterator[tuple[str, int, bytes]]:
        while True:
            found = self.read(timeout)
            if found is not None:
                yield found


@contextmanager
def viewer(port: int, protocol: str = PROTOCOL) -> Iterator[Viewer]:
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None) as connection:  # type: ignore[list-item]
        yield Viewer(connection)
