"""The rig, from the side of the page: followed in threads, told to the hub in the event loop's."""

import asyncio
import logging
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event as Flag
from threading import Lock, Thread
from typing import Any

from service.errors import ServiceError
from service.messages.decoding import Received
from service.web.hub import Hub, Link
from service.web.images import SOURCES, Picture
from service.web.options import PageOptions
from service.web.thumbnails import drawn
from service.wire.client import Client
from service.wire.subscription import Subscription

_JSON = ("status", "scan/progress", "replay/state", "fused/report")

_SILENT = 3.0
"""Seconds without a status, which is told each second, after which the rig is taken for lost."""
_BEAT = 0.25
_ASKED = 4.0
"""Seconds between two looks at who answers."""
_GRACE = 5.0
"""Seconds that images are followed after nobody shows them any more: somebody may turn a page."""
_DRAWN = 1.0
"""Seconds between two thumbnails: a stream has many maps."""

_VARYING = frozenset({"state", "reason"})
"""What a manifest tells that the status tells too, and sooner."""

_log = logging.getLogger(__name__)


class RigWatch:
    """Follows a rig that may come and go.

    Args:
        options: where it is.
        loop: where the hub is at home.
        hub: told of everything.
    """

    def __init__(self, options: PageOptions, loop: asyncio.AbstractEventLoop, hub: Hub) -> None:
        self._options, self._loop, self._hub = options, loop, hub
        self.client = Client(options.endpoint, options.prefix, config=options.client)
        self._ending = Flag()
        self._heard = self._drawn = 0.0
        self._undrawn: Received | None = None
        self._gone = True
        self._rigs = 0
        self._ambiguity_range: float | None = None
        self._uptime = float("inf")
        self._undescribed = True
        self._followed: dict[str, tuple[Subscription, ...]] = {}
        self._unwanted: dict[str, float] = {}
        self._sequence: dict[str, int] = {}
        self._waiting: dict[str, Picture] = {}
        self._posting = Lock()
        self._threads = [
            Thread(target=self._follow_images, name="page images", daemon=True),
            Thread(target=self._ask_who, name="page rig", daemon=True),
        ]

    def start(self) -> None:
        """Begin to follow it."""
        for topic in _JSON:
            self.client.subscribe(topic, self._json_came)
        self.client.subscribe("log", lambda received: self._post(self._hub.logged, received))
        self.client.subscribe("fused/depth", self._depth_came)
        self.client.watch_presence(self._presence_changed)
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End it; what is asked of the rig meanwhile fails."""
        self._ending.set()
        for thread in self._threads:
            thread.join(5.0)
        self.client.close()

    def _json_came(self, received: Received) -> None:
        if received.topic == "status":
            self._heard, self._gone = time.monotonic(), False
            uptime = float(received.value.get("uptime", 0.0))
            # Of several with one name each has its own: that is no restart.
            self._undescribed |= uptime < self._uptime and self._rigs <= 1
            self._uptime = uptime
            self._tell_link()
        self._post(self._hub.heard, received)

    def _presence_changed(self, present: bool) -> None:
        if not present:
            self._gone = True
            self._tell_link()

    def _depth_came(self, received: Received) -> None:
        self._image_came(received)
        self._undrawn = received

    def _frame_came(self, received: Received) -> None:
        told = received.value.get("ambiguity_range")
        self._ambiguity_range = float(told) if isinstance(told, (int, float)) else None

    def _image_came(self, received: Received) -> None:
        """Hand an image over; where the loop is behind, the newest of each topic takes the others' place."""
        if received.topic == "camera/distance" and self._ambiguity_range is None:
            return  # it is not known yet what its counts mean
        for topic, source in SOURCES.items():
            if source == received.topic:
                count = self._sequence[topic] = self._sequence.get(topic, 0) + 1
                picture = Picture(topic, received, count, time.time(), self._ambiguity_range)
                with self._posting:
                    is_waited_for = topic in self._waiting
                    self._waiting[topic] = picture
                if not is_waited_for:
                    self._post(self._take, topic)

    def _take(self, topic: str) -> None:
        with self._posting:
            picture = self._waiting.pop(topic)
        self._hub.seen(picture)

    def _follow_images(self) -> None:
        """Subscribe to what is shown, and to nothing else; draw a thumbnail now and then."""
        while not self._ending.wait(_BEAT / 5):
            try:
                self._draw()
                self._follow({SOURCES[topic] for topic in self._hub.wanted} - {"fused/depth"})
            except Exception:  # the next look may do better
                _log.exception("images cannot be followed")

    def _draw(self) -> None:
        now, depth = time.monotonic(), self._undrawn
        if depth is not None and depth.timestamp is not None and now - self._drawn >= _DRAWN:
            self._undrawn, self._drawn = None, now
            self._post(self._hub.pictured, depth.timestamp, drawn(depth.value), depth.value.shape)

    def _follow(self, wanted: set[str]) -> None:
        now = time.monotonic()
        for source in wanted:
            self._unwanted.pop(source, None)
            if source not in self._followed:
                self._followed[source] = self._subscribed(source)
        for source in set(self._followed) - wanted:
            if now - self._unwanted.setdefault(source, now) > _GRACE:
                self._leave(source)

    def _subscribed(self, source: str) -> tuple[Subscription, ...]:
        images = self.client.subscribe(source, self._image_came)
        if source != "camera/distance":
            return (images,)
        return self.client.subscribe("camera/frame", self._frame_came), images

    def _leave(self, source: str) -> None:
        del self._unwanted[source]
        for subscription in self._followed.pop(source):
            subscription.close()
        self._post(self._hub.forget_images, frozenset(t for t, s in SOURCES.items() if s == source))

    def _ask_who(self) -> None:
        """See whether it is there, how many there are, and what it offers."""
        asked = 0.0
        while not self._ending.wait(_BEAT):
            now = time.monotonic()
            if now - asked >= _ASKED or (self._undescribed and self._is_up):
                asked = now
                with suppress(ServiceError):
                    self._describe()
            self._tell_link()

    def _describe(self) -> None:
        manifests = self.client.manifests()
        self._rigs = len(manifests)
        if self._undescribed and manifests:
            schemas = self.client.command_schemas()
            if schemas:
                self._undescribed = False
                manifest = {key: value for key, value in manifests[0].items() if key not in _VARYING}
                self._post(self._hub.described, manifest, schemas)

    @property
    def _is_up(self) -> bool:
        return not self._gone and time.monotonic() - self._heard < _SILENT

    def _tell_link(self) -> None:
        self._post(self._hub.connected, self._link())

    def _link(self) -> Link:
        where = f"{self._options.endpoint} under the name {self._options.prefix}"
        if not self._is_up:
            return Link(False, time.time(), 0, f"no rig answers at {where}: start one with `lidarboost run`")
        if self._rigs > 1:
            said = f"{self._rigs} rigs answer at {where}, mixed up here: give each a zenoh.prefix of its own"
            return Link(True, time.time(), self._rigs, said)
        return Link(True, time.time(), 1, "")

    def _post(self, call: Callable[..., Any], *arguments: Any) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(call, *arguments)
