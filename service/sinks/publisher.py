"""Publishing: messages by topic, each with the policy of the table, from a thread of its own."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Lock, Thread
from types import TracebackType
from typing import Any, Self

import zenoh
import zenoh.ext

from drivers.messages import Message
from service.messages.topics import ALIVE, TOPICS, Congestion, Topic
from service.sinks.queue import Outbox
from service.wire.addresses import DEFAULT_PREFIX
from service.wire.sockets import bytes_under_way

_QUEUE_ITEMS = 2000
_QUEUE_BYTES = 64 << 20
"""Ten seconds of a camera at 50 frames/s, or a dozen sets of fused maps."""

_MISS_HEARTBEAT = 1.0
"""Seconds after which a subscriber that recovers losses hears of the last message, if it missed that one."""

_POLL = 0.02
_QUIET_POLLS = 3
"""Drained means: nothing under way in three looks 20 ms apart. Between two looks Zenoh's sender refills an
empty socket, and a peer maps shared memory that it has just been told of."""

_BLIND_WAIT = 0.5
"""Seconds granted to peers that cannot be looked at (links other than TCP)."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Later:
    """A message that is made only if somebody wants it."""

    topic: str
    make: Callable[[], Message]


class Publisher:
    """Publishes messages under a prefix; `get` on what the table keeps is answered with the latest value.

    Args:
        session: an open session; it must outlive the publisher.
        prefix: what every key begins with.
        lossless: `publish` waits for slow subscribers instead of dropping (a replay that has time).
    """

    def __init__(
        self, session: zenoh.Session, prefix: str = DEFAULT_PREFIX, *, lossless: bool = False
    ) -> None:
        self._session, self._prefix, self._lossless = session, prefix, lossless
        self._lock = Lock()
        self._dropped: Counter[str] = Counter()
        self._latest: dict[str, Message | _Later] = {}
        self._outbox: Outbox[Message | _Later] = Outbox(
            _QUEUE_ITEMS, _QUEUE_BYTES, lossless=lossless, dropped=self._count, droppable=_may_drop
        )
        published = [topic for topic in TOPICS.values() if topic.congestion is not Congestion.NONE]
        self._publishers = {topic.name: self._declare(topic) for topic in published}
        self._queryables = [self._answer(topic) for topic in published if topic.latest]
        self._token = session.liveliness().declare_token(self.key(ALIVE))
        self._thread = Thread(target=self._run, name="publisher", daemon=True)
        self._thread.start()

    def key(self, topic: str) -> str:
        """The Zenoh key of a topic."""
        return f"{self._prefix}/{topic}"

    def publish(self, messages: Sequence[Message]) -> None:
        """Hand messages over; never waits unless `lossless`."""
        for message in messages:
            self._outbox.put(message, len(message.payload))

    def publish_lazily(self, topic: str, make: Callable[[], Message]) -> None:
        """Publish what `make` returns, made in the publisher's thread and only if somebody wants it."""
        self._outbox.put(_Later(topic, make), 0)

    @property
    def dropped(self) -> dict[str, int]:
        """Messages that the queue here had no room for, by topic."""
        with self._lock:
            return dict(self._dropped)

    def drain(self, timeout: float = 10.0) -> bool:
        """Wait until subscribers have received all that was published; False where that was not seen in time.

        Zenoh has no such call, and closing a session loses what a subscriber has not read yet (shared memory
        above all: it goes with its owner). So the kernel is asked what is still under way on each connection.
        """
        deadline = time.monotonic() + timeout
        if not self._outbox.wait_empty(timeout):
            return False
        quiet = 0
        while quiet < _QUIET_POLLS:
            under_way = self._under_way()
            if under_way is None:
                time.sleep(_BLIND_WAIT)
                return True
            quiet = 0 if under_way else quiet + 1
            if time.monotonic() > deadline:
                return False
            time.sleep(_POLL)
        return True

    def close(self, timeout: float = 10.0) -> None:
        """Drain for at most `timeout` seconds, then withdraw everything declared."""
        if not self._thread.is_alive():
            return
        if not self.drain(timeout):
            _log.warning("a subscriber did not take everything within %g s; what it missed is lost", timeout)
        self._outbox.clear()
        self._outbox.close()
        self._thread.join(timeout)
        for declared in (*self._queryables, *self._publishers.values(), self._token):
            declared.undeclare()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        while (item := self._outbox.get()) is not None:
            try:
                self._send(item)
            except Exception:  # the thread must live: a failed message is lost, counted and told
                _log.exception("cannot publish %s", item.topic)
                self._count(item)

    def _send(self, item: Message | _Later) -> None:
        topic = TOPICS[item.topic]
        if topic.latest:
            with self._lock:
                self._latest[item.topic] = item
        publisher = self._publishers[item.topic]
        if isinstance(item, _Later):
            if publisher.matching_status.matching:
                self._put(publisher, self._made(item))
        else:
            self._put(publisher, item)

    def _put(self, publisher: Any, message: Message) -> None:
        publisher.put(message.payload, encoding=encoding(message))

    def _made(self, item: Message | _Later) -> Message:
        """The message itself; made once, however often it is asked for."""
        if isinstance(item, Message):
            return item
        message = item.make()
        with self._lock:
            if self._latest.get(item.topic) is item:
                self._latest[item.topic] = message
        return message

    def _declare(self, topic: Topic) -> Any:
        blocks = self._lossless or topic.congestion is Congestion.BLOCK
        policy = zenoh.CongestionControl.BLOCK if blocks else zenoh.CongestionControl.DROP
        # Frames give way to fused maps and reports on a thin link.
        priority = zenoh.Priority.DATA if topic.latest else zenoh.Priority.DATA_LOW
        key = self.key(topic.name)
        if not topic.latest or _is_lazy(topic):
            return self._session.declare_publisher(key, congestion_control=policy, priority=priority)
        return zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=policy,
            priority=priority,
            cache=zenoh.ext.CacheConfig(max_samples=1),
            publisher_detection=True,
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=None, sporadic_heartbeat=_MISS_HEARTBEAT
            ),
        )

    def _answer(self, topic: Topic) -> zenoh.Queryable[None]:
        key = self.key(topic.name)

        def reply(query: zenoh.Query) -> None:
            with query:
                with self._lock:
                    item = self._latest.get(topic.name)
                if item is not None:
                    message = self._made(item)
                    query.reply(key, message.payload, encoding=encoding(message))

        return self._session.declare_queryable(key, reply, complete=True)

    def _under_way(self) -> int | None:
        ports = []
        for link in self._session.info.links():
            if not link.src.startswith("tcp/") and not link.src.startswith("tls/"):
                return None
            ports.append((_port(link.src), _port(link.dst)))
        return bytes_under_way(ports)

    def _count(self, item: Message | _Later) -> None:
        with self._lock:
            self._dropped[item.topic] += 1


def encoding(message: Message) -> zenoh.Encoding:
    """`application/protobuf;foxglove.RawImage` and the like."""
    kind = zenoh.Encoding.APPLICATION_PROTOBUF
    if message.message_encoding == "json":
        kind = zenoh.Encoding.APPLICATION_JSON
    return kind.with_schema(message.schema.name)


def _may_drop(item: Message | _Later) -> bool:
    return TOPICS[item.topic].congestion is Congestion.DROP


def _is_lazy(topic: Topic) -> bool:
    """Made on demand: an advanced publisher cannot tell whether anybody listens, and its cache needs all."""
    return not topic.recorded


def _port(locator: str) -> int:
    return int(locator.partition("?")[0].rpartition(":")[2])
