"""Serves what happens to Foxglove and Lichtblick, over a WebSocket."""

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from drivers.messages import Message
from service.config.served import FoxgloveSection
from service.errors import ConfigurationError, OutputError
from service.messages.encoding import event_messages
from service.messages.events import Event, FrameCaptured, MapFused, ReplayTold
from service.messages.schemas import topic_schemas
from service.messages.topics import FUSED_POINTS, TOPICS
from service.messages.viewing import ON_DEMAND, Extras
from service.sinks.foxglove_replay import Ask, ReplayControl
from service.sinks.sink import Room, Sink

if TYPE_CHECKING:
    from foxglove import Channel
    from foxglove.websocket import WebSocketServer

_BACKLOG = 64
"""Messages that wait for a client: one that stalls costs 83 MB so, and 430 MB with the library's 1024."""

_THINNED = Extras(points=4)
"""As many points as a frame has pixels: a viewer shows no more, and all of them cost 8 MB a map."""

_MADE: dict[str, Callable[[MapFused], Message]] = {
    **ON_DEMAND,
    FUSED_POINTS: lambda event: _THINNED.of(event)[0],
}

_LET_GO, _POLL = 5.0, 0.05
"""Seconds that a stopped server may keep its port, and between two looks."""

_OF_THE_SENSOR = ("camera/", "stage/", "fused/")
"""Topics whose messages bear the time of a frame."""


class Foxglove(Sink):
    """A server that viewers connect to; those that come late get the latest of what the table keeps.

    While a recording is played it offers playback control, which `cmd/replay` carries out. A server says
    when it begins whether it does, so another one begins where a replay is loaded or ended, and viewers
    connect again.

    Args:
        section: where it listens.
        ask: has `cmd/replay` do something.
    """

    room = Room(64, 64 << 20)
    droppable = (FrameCaptured, MapFused)
    newest_suffice = True

    def __init__(self, section: FoxgloveSection, ask: Ask) -> None:
        super().__init__()
        self._section = section
        self._replay = ReplayControl(ask)
        self._channels: dict[str, Channel] = {}
        self._latest: dict[str, Message | MapFused] = {}
        self._server: WebSocketServer | None = None
        self._has_served = False
        self.port = section.port

    def open(self) -> None:
        foxglove = _library()
        self._context = foxglove.Context()
        for topic, schema in topic_schemas().items():
            self._channels[topic] = foxglove.Channel(
                f"/{topic}",
                schema=foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
                message_encoding="protobuf" if schema.encoding == "protobuf" else "json",
                context=self._context,
            )
        self._serve()

    def take(self, event: Event) -> None:
        if isinstance(event, ReplayTold):
            self._follow(event)
        for message in event_messages(event):
            if TOPICS[message.topic].latest:
                self._latest[message.topic] = message
            self._say(message)
        if isinstance(event, MapFused):
            for topic, make in _MADE.items():
                self._latest[topic] = event
                if self._channels[topic].has_sinks():
                    self._say(make(event))

    def close(self) -> None:
        self._stop()
        for channel in self._channels.values():
            channel.close()
        self._channels = {}

    def repeat(self, topic: str) -> None:
        """Say the latest of a topic again: the library keeps nothing for those who come late."""
        latest = self._latest.get(topic)
        if latest is not None and not self.abandoned.is_set():
            self._log(_MADE[topic](latest) if isinstance(latest, MapFused) else latest)

    def _follow(self, event: ReplayTold) -> None:
        """Begin with another server where there is something else to play, else tell where it is."""
        if self._replay.follow(event.replay):
            self._stop()
            self._serve()
        elif self._server is not None and self._replay.is_loaded:
            self._server.broadcast_playback_state(self._replay.state())

    def _serve(self) -> None:
        deadline = time.monotonic() + _LET_GO
        while True:
            try:
                self._server = self._started()
                break
            except Exception as error:  # the library's own, of many kinds
                # One that was just stopped lets go of its port in its own time.
                if not self._has_served or time.monotonic() > deadline:
                    raise OutputError(
                        f"foxglove: cannot listen on {self._section.host}:{self.port} ({error}); set another "
                        "foxglove.port"
                    ) from error
            time.sleep(_POLL)
        self.port, self._has_served = self._server.port, True

    def _started(self) -> "WebSocketServer":
        server: WebSocketServer = _library().start_server(
            name="lidarboost",
            host=self._section.host,
            port=self.port,
            context=self._context,
            server_listener=_listener(self.repeat, self._replay.carry_out),
            message_backlog_size=_BACKLOG,
            playback_time_range=self._replay.span,
        )
        return server

    def _stop(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.stop()

    def _say(self, message: Message) -> None:
        if self._channels[message.topic].has_sinks():
            self._log(message)

    def _log(self, message: Message) -> None:
        own = message.publish_time if message.topic.startswith(_OF_THE_SENSOR) else None
        self._channels[message.topic].log(message.payload, log_time=own or self._replay.now or time.time_ns())


def _listener(repeat: Callable[[str], None], carry_out: Callable[[Any], Any]) -> Any:
    """What the library tells of its clients."""
    from foxglove.websocket import ServerListener

    class Listener(ServerListener):
        def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
            repeat(channel.topic.removeprefix("/"))

        def on_playback_control_request(self, playback_control_request: Any) -> Any:
            return carry_out(playback_control_request)

    return Listener()


def _library() -> Any:
    """The library; raises `ConfigurationError` where it is not installed."""
    try:
        import foxglove
    except ImportError as error:
        raise ConfigurationError(
            "the sink foxglove needs the library foxglove-sdk: pip install 'lidarboost[foxglove]'"
        ) from error
    # It says of every message that a client did not take so, and what the log says is a message again.
    logging.getLogger("foxglove").setLevel(logging.CRITICAL)
    return foxglove
