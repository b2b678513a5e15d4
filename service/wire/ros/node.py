"""A ROS node: its publishers, as rmw_zenoh makes them."""

import time
from collections.abc import Iterable
from typing import Any, NamedTuple

import zenoh
import zenoh.ext

from service.messages.ros.topics import ROS_TOPICS, RosTopic
from service.messages.ros.types import RosMessage, RosTypes
from service.wire.declarations import lasting_publisher, withdraw
from service.wire.ros.names import Node, attachment, data_key, gid

_CDR = zenoh.Encoding("application/cdr")

_MISS_HEARTBEAT = 1.0
"""Seconds after which late subscribers are told of the last message, so that they can ask for it."""


class _Publisher(NamedTuple):
    declared: Any
    token: Any
    gid: bytes
    latched: bool


class RosNode:
    """Publishes the topics of `ROS_TOPICS` under a namespace.

    Args:
        session: open; without a namespace of its own.
        types: of the distribution.
        domain: ROS_DOMAIN_ID.
        namespace: of node and topics, `/` = none.
        name: of the node.
    """

    def __init__(
        self, session: zenoh.Session, types: RosTypes, *, domain: int, namespace: str, name: str
    ) -> None:
        self._session, self._types = session, types
        self._domain, self._namespace = domain, namespace
        self.node = Node(domain, str(session.zid()), namespace, name)
        self._token = session.liveliness().declare_token(self.node.token)
        self._sent: dict[str, int] = {}
        # 0 is the node itself.
        self._publishers = {
            topic.name: self._declare(number, topic) for number, topic in enumerate(ROS_TOPICS.values(), 1)
        }

    def is_heard(self, topic: str) -> bool:
        """Whether somebody listens; of latched topics that is not known, and somebody may come."""
        publisher = self._publishers[topic]
        return publisher.latched or bool(publisher.declared.matching_status.matching)

    def publish(self, messages: Iterable[RosMessage]) -> None:
        """Put messages, in order."""
        for message in messages:
            publisher = self._publishers[message.topic]
            number = self._sent[message.topic] = self._sent.get(message.topic, 0) + 1
            publisher.declared.put(
                message.payload,
                encoding=_CDR,
                attachment=attachment(number, time.time_ns(), publisher.gid),
            )

    def close(self) -> None:
        """Leave the graph; publishers stay until the session ends."""
        withdraw([*(publisher.token for publisher in self._publishers.values()), self._token])

    def _declare(self, number: int, topic: RosTopic) -> _Publisher:
        name, type_hash = topic.full(self._namespace), self._types.hash(topic.kind)
        key = data_key(self._domain, name, topic.kind, type_hash)
        token = self.node.publisher_token(number, name, topic.kind, type_hash, topic.latched)

        def declare() -> Any:
            if not topic.latched:
                return self._session.declare_publisher(key)
            return zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=_MISS_HEARTBEAT
                ),
            )

        declared = lasting_publisher(self._session, key, declare)
        return _Publisher(
            declared, self._session.liveliness().declare_token(token), gid(token), topic.latched
        )
