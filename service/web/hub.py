"""What is known of the rig, and who is told: every page begins with it, and hears what comes."""

import json
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from service.errors import RemoteError
from service.messages.decoding import Received, read
from service.messages.status import Status
from service.versions import software_version
from service.web.encoded import Encoded
from service.web.history import History
from service.web.images import SOURCES, Picture
from service.web.options import PageOptions
from service.web.outbox import Outbox
from service.web.thumbnails import Thumbnail, Thumbnails

PROTOCOL = 1

_LOG_LINES = 200


@dataclass(frozen=True, slots=True)
class Link:
    """Whether a rig answers.

    Attributes:
        up: it does.
        since: seconds since the epoch.
        rigs: how many answer to its name.
        message: what is wrong, and what to do.
    """

    up: bool
    since: float
    rigs: int
    message: str


class Hub:
    """The state of the page; for the event loop's thread.

    Args:
        options: of the server.
    """

    def __init__(self, options: PageOptions) -> None:
        self._options = options
        self.outboxes: set[Outbox] = set()
        self.thumbnails = Thumbnails()
        self._history = History()
        self._log: deque[dict[str, Any]] = deque(maxlen=_LOG_LINES)
        self._rig: str | None = None
        self._messages: dict[str, str] = {}
        self._images: dict[str, Encoded] = {}
        self.wanted: frozenset[str] = frozenset()
        """The images that somebody shows; may be read by any thread."""
        self.link = Link(False, time.time(), 0, "looking for the rig")

    def join(self, outbox: Outbox) -> None:
        """A page is opened: it is told all there is, then what comes."""
        for message in self._greeting():
            outbox.put(message)
        if self._rig is not None:
            outbox.put_text(self._rig)
        outbox.put({"type": "history", "samples": self._history.samples})
        outbox.put({"type": "log", "lines": list(self._log)})
        outbox.put({"type": "bursts", "bursts": [t.told() for t in self.thumbnails.newest_first]})
        for topic, text in self._messages.items():
            outbox.put_newest(topic, text)
        self.outboxes.add(outbox)

    def leave(self, outbox: Outbox) -> None:
        """A page is closed."""
        self.outboxes.discard(outbox)
        self._count()

    def show(self, outbox: Outbox, topics: frozenset[str]) -> None:
        """What a page shows from now on."""
        for topic in outbox.show(topics):
            if topic in self._images:
                outbox.put_image(topic, self._images[topic])
        self._count()

    def forget_images(self, topics: frozenset[str]) -> None:
        """Nobody follows these any more: what was kept of them grows old."""
        for topic in topics:
            self._images.pop(topic, None)

    def connected(self, link: Link) -> None:
        """The rig came, or went."""
        if (link.up, link.rigs, link.message) != (self.link.up, self.link.rigs, self.link.message):
            self.link = link
            self._tell({"type": "link", **asdict(link)})

    def described(self, manifest: dict[str, Any], schemas: dict[str, Any]) -> None:
        """What the rig is and offers."""
        self._rig = json.dumps({"type": "rig", "manifest": manifest, "schemas": schemas})
        self._tell_text(self._rig)

    def heard(self, received: Received) -> None:
        """A JSON message of the rig."""
        text = json.dumps({"type": "message", "topic": received.topic, "value": received.value})
        self._messages[received.topic] = text
        for outbox in self.outboxes:
            outbox.put_newest(received.topic, text)
        if received.topic == "status":
            self._sample(received)
        if received.topic == "fused/report" and received.timestamp is not None:
            self._show_burst(self.thumbnails.add_report(received.timestamp, received.value))

    def logged(self, received: Received) -> None:
        """A line of the rig's log."""
        record = received.value
        line = {
            "time": (received.timestamp or 0) / 1e9,
            "level": type(record).Level.Name(record.level),
            "name": record.name,
            "message": record.message,
        }
        self._log.append(line)
        self._tell({"type": "log", "lines": [line]})

    def pictured(self, timestamp: int, png: bytes, shape: tuple[int, int]) -> None:
        """A map's thumbnail is drawn."""
        self._show_burst(self.thumbnails.add_picture(timestamp, png, shape))

    def seen(self, picture: Picture) -> None:
        """An image came."""
        image = Encoded(picture)
        self._images[picture.topic] = image
        for outbox in self.outboxes:
            outbox.put_image(picture.topic, image)

    def _count(self) -> None:
        self.wanted = frozenset().union(*(outbox.shown for outbox in self.outboxes))

    def _greeting(self) -> Iterator[dict[str, Any]]:
        yield {
            "type": "hello",
            "protocol": PROTOCOL,
            "version": software_version(),
            "prefix": self._options.prefix,
            "endpoint": self._options.endpoint,
            "time": time.time(),
            "images": list(SOURCES),
        }
        yield {"type": "link", **asdict(self.link)}

    def _sample(self, received: Received) -> None:
        try:
            status = read(Status, received)
        except RemoteError:  # of another version: the page shows what it understands of it
            return
        self._tell({"type": "sample", "sample": self._history.add(status, time.time())})

    def _show_burst(self, made: Thumbnail | None) -> None:
        if made is not None:
            self._tell({"type": "burst", "burst": made.told()})

    def _tell(self, message: dict[str, Any]) -> None:
        self._tell_text(json.dumps(message))

    def _tell_text(self, text: str) -> None:
        for outbox in self.outboxes:
            outbox.put_text(text)
