"""ROS 2: libraries, and nodes that look for these topics under keys that nearly match."""

from __future__ import annotations

from collections.abc import Iterator

from service.config.sections import Configuration
from service.doctor.check import Check
from service.errors import ConfigurationError, SessionError

_EXTRA = "pip install 'lidarboost[ros2]'"


def check_ros2(configuration: Configuration) -> Iterator[Check]:
    """Can ROS 2 nodes understand the service? Looked at only where `[ros2]` is enabled."""
    if not configuration.ros2.enabled:
        return
    from service.sinks.ros import ros_sink

    try:
        ros_sink(configuration.ros2, configuration.zenoh.config)
    except ConfigurationError as error:
        yield Check(name="ROS 2", state="problem", finding=str(error).partition(":")[0], remedy=_EXTRA)
        return
    try:
        found = list(_misses(configuration))
    except SessionError as error:
        yield Check(
            name="ROS 2",
            state="warning",
            finding=f"nothing can be seen of ROS 2: {error}",
            remedy="start the service, or the router (zenohd), and look again",
        )
        return
    for line in found:
        yield Check(
            name="ROS 2",
            state="warning",
            finding=f"does not match: {line}",
            remedy="make domain, distribution and message packages the same on both sides",
        )
    if not found:
        section = configuration.ros2
        where = f"domain {section.domain}, {section.namespace}, {section.distribution}"
        yield Check(name="ROS 2", state="ok", finding=f"{where}: no node asks for these topics in vain")


def _misses(configuration: Configuration) -> Iterator[str]:
    from service.messages.ros.topics import ROS_TOPICS
    from service.messages.ros.types import RosTypes
    from service.wire.ros.graph import Endpoint, endpoints, near_misses
    from service.wire.ros.names import dds_type
    from service.wire.ros.session import service_endpoints
    from service.wire.session import open_session

    section = configuration.ros2
    types = RosTypes(section.distribution)
    ours = [
        Endpoint(
            role="publisher",
            domain=section.domain,
            node=f"{section.namespace.rstrip('/')}/lidarboost",
            topic=topic.full(section.namespace),
            kind=dds_type(topic.kind),
            type_hash=types.hash(topic.kind),
        )
        for topic in ROS_TOPICS.values()
    ]
    connect = () if section.config is not None else service_endpoints(configuration.zenoh.config)
    with open_session(listen=(), connect=connect, file=section.config, mode="client") as session:
        yield from near_misses(ours, endpoints(session))
