"""Publishing on Zenoh: messages by topic, each with the policy of the table."""

import logging
import time
from collections.abc import Sequence
from threading import Lock
from typing import Any

import zenoh
import zenoh.ext

from drivers.messages import Message
from service.allowance import Allowance
from service.messages.encoding import event_messages
from service.messages.events import Delivery, Event, FrameCaptured, MapFused
from service.messages.status import Subscriber
from service.messages.topics import ALIVE, TOPICS, Congestion, Topic
from service.messages.viewing import ON_DEMAND
from service.sinks.sink import Room, Sink
from service.wire.addresses import DEFAULT_PREFIX
from service.wire.declarations import lasting_publisher, withdraw
from service.wire.encoding import encoding
from service.wire.receipts import Receipts
from service.wire.sockets import bytes_under_way, is_tcp, ports_of

PUBLISHER = "publisher"
"""How the sink is called."""

_MISS_HEARTBEAT = 1.0
"""Seconds after which a subscriber that recovers losses hears of the last message, if it missed that one."""

_HANDOVER, _HANDOVER_LIVE = 25.0, 2.0
"""Seconds that subscribers get at the end to take what was published: in a lossless run, and live."""

_STUCK = 1.0
"""Seconds in which nothing may move, live, before those who still have to read are given up."""

_REMEMBERED = 64
"""Small messages that a subscriber which missed some can have again."""

_POLL = 0.02
_QUIET_POLLS = 3
"""Drained means: nothing under way in three looks 20 ms apart. Between two looks Zenoh's sender refills an
empty socket, and a peer maps shared memory that it has just been told of."""

_BLIND_WAIT = 0.5
"""Seconds granted to peers that cannot be looked at (links other than TCP)."""

_log = logging.getLogger(__name__)


class Publisher(Sink):
    """Publishes under a prefix; `get` on what the table keeps is answered with the latest value.

    Args:
        session: an open session; it must outlive the publisher.
        prefix: what every key begins with.
        lossless: a put waits for slow subscribers instead of dropping (a replay that has time).
        raw_rate: frames published per second at most; None = all.
    """

    room = Room(2000, 64 << 20)
    """Ten seconds of a camera at 50 frames/s, or a dozen fused maps."""
    droppable = (FrameCaptured, MapFused)

    def __init__(
        self,
        session: zenoh.Session,
        prefix: str = DEFAULT_PREFIX,
        *,
        lossless: bool = False,
        raw_rate: float | None = None,
    ) -> None:
        super().__init__()
        self._session, self._prefix, self._lossless = session, prefix, lossless
        self._frames = None if raw_rate is None else Allowance(raw_rate, 1.0)
        self._lock = Lock()
        self._latest: dict[str, Message | MapFused] = {}
        self._declared: list[Any] = []
        self._receipts: Receipts | None = None
        self._undelivered = False
        self.published = 0

    def open(self) -> None:
        published = [topic for topic in TOPICS.values() if topic.congestion is not Congestion.NONE]
        self._publishers = {topic.name: self._publisher(topic) for topic in published}
        self._declared = [self._answer(topic) for topic in published if topic.latest]
        self._receipts = Receipts(self._session, self._prefix)
        self._declared.append(self._session.liveliness().declare_token(self.key(ALIVE)))

    def take(self, event: Event) -> None:
        if isinstance(event, Delivery):
            event.deliver()
            return
        if isinstance(event, FrameCaptured) and self._frames is not None and not self._frames.spend():
            return
        if isinstance(event, MapFused):
            self._expect_receipts(event)
        self.publish(event_messages(event))
        if isinstance(event, MapFused):
            self._publish_on_demand(event)

    def close(self) -> None:
        """Hand over what was published, then withdraw what was declared, but for publishers, which stay."""
        timeout = _HANDOVER if self._lossless else _HANDOVER_LIVE
        if self._declared and not self.drain(timeout):
            self._undelivered = True
            _log.warning("a subscriber did not take everything in time; what it missed is lost")
        if self._receipts is not None:
            self._declared.append(self._receipts)
            self._receipts = None
        declared, self._declared = self._declared, []
        withdraw(declared)

    @property
    def losses(self) -> tuple[str, ...]:
        return ("a subscriber did not take everything that was published",) if self._undelivered else ()

    @property
    def subscribers(self) -> tuple[Subscriber, ...]:
        """Those who say when messages are in hand."""
        receipts = self._receipts
        return () if receipts is None else receipts.subscribers

    def key(self, topic: str) -> str:
        """The Zenoh key of a topic."""
        return f"{self._prefix}/{topic}"

    def publish(self, messages: Sequence[Message]) -> None:
        """Publish messages, in order."""
        for message in messages:
            if self.abandoned.is_set():
                return
            self._keep(message.topic, message)
            self._put(self._publishers[message.topic], message)

    def drain(self, timeout: float = 10.0) -> bool:
        """Wait until subscribers have received all that was published; False where that was not seen in time.

        Zenoh has no such call, and closing a session loses what a subscriber has not read yet (shared memory
        above all: it goes with its owner). So the kernel is asked what is still under way on each connection.
        """
        moved = time.monotonic()
        deadline, patience = moved + timeout, timeout if self._lossless else _STUCK
        quiet, before = 0, -1
        while quiet < _QUIET_POLLS:
            under_way, now = self._under_way(), time.monotonic()
            if under_way is None:
                time.sleep(_BLIND_WAIT)
                return True
            quiet = 0 if under_way else quiet + 1
            moved, before = (moved if under_way == before else now), under_way
            if now > min(deadline, moved + patience):
                return False
            time.sleep(_POLL)
        return True

    def _expect_receipts(self, event: MapFused) -> None:
        told = event.map.report
        if self._receipts is not None and told.latency is not None:
            self._receipts.expect(event.map.frame.timestamp, time.monotonic() - told.latency)

    def _publish_on_demand(self, event: MapFused) -> None:
        """Some of a map is made only while somebody listens, or when it is asked for."""
        for topic, make in ON_DEMAND.items():
            self._keep(topic, event)
            publisher = self._publishers[topic]
            if publisher.matching_status.matching:
                self._put(publisher, make(event))

    def _keep(self, topic: str, latest: Message | MapFused) -> None:
        if TOPICS[topic].latest:
            with self._lock:
                self._latest[topic] = latest

    def _put(self, publisher: Any, message: Message) -> None:
        publisher.put(message.payload, encoding=encoding(message))
        self.published += 1

    def _publisher(self, topic: Topic) -> Any:
        return lasting_publisher(self._session, self.key(topic.name), lambda: self._declare(topic))

    def _declare(self, topic: Topic) -> Any:
        # Live, nothing waits for a link that is full: it would hold up all other subscribers.
        policy = zenoh.CongestionControl.BLOCK if self._lossless else zenoh.CongestionControl.DROP
        is_small = topic.congestion is Congestion.AHEAD
        priority, key = self._priority(topic), self.key(topic.name)
        # An advanced publisher cannot tell whether anybody listens, and its cache needs all.
        if not topic.latest or topic.name in ON_DEMAND:
            return self._session.declare_publisher(key, congestion_control=policy, priority=priority)
        return zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=policy,
            priority=priority,
            cache=zenoh.ext.CacheConfig(max_samples=_REMEMBERED if is_small else 1),
            publisher_detection=True,
            # Not the sporadic one: that waits for full links.
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=_MISS_HEARTBEAT, sporadic_heartbeat=None
            ),
        )

    def _priority(self, topic: Topic) -> zenoh.Priority:
        """Frames give way to fused maps on a thin link, both to what is small; lossless, maps keep order."""
        if topic.congestion is Congestion.AHEAD and not self._lossless:
            return zenoh.Priority.DATA_HIGH
        return zenoh.Priority.DATA if topic.latest else zenoh.Priority.DATA_LOW

    def _answer(self, topic: Topic) -> zenoh.Queryable[None]:
        key = self.key(topic.name)

        def reply(query: zenoh.Query) -> None:
            with query:
                with self._lock:
                    latest = self._latest.get(topic.name)
                if latest is not None and not self.abandoned.is_set():
                    message = ON_DEMAND[topic.name](latest) if isinstance(latest, MapFused) else latest
                    query.reply(key, message.payload, encoding=encoding(message))

        return self._session.declare_queryable(key, reply, complete=True)

    def _under_way(self) -> int | None:
        if not all(is_tcp(link.src) for link in self._session.info.links()):
            return None
        return bytes_under_way(ports_of(self._session))
