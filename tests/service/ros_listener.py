"""A client that is not ours (`pyzeros`), and what it receives of the ROS 2 sink."""

import asyncio
import time

import numpy as np
import pytest
from ros_rig import client, events, ros_rig

from service.messages.ros.topics import ROS_TOPICS
from service.messages.ros.types import RosTypes

pyzeros = pytest.importorskip("pyzeros", reason="needs pyzeros")

HASHES = {
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}
"""As the official message packages have them; of tf2_msgs and diagnostic_msgs as rosbags computes them."""

ABSOLUTE = {topic.full("/lidarboost"): topic for topic in ROS_TOPICS.values()}


def stand_in(kind):
    """A message type for a subscriber that wants bytes alone."""
    return type("Kind", (), {"get_type_name": lambda: kind, "hash_rihs01": lambda: f"RIHS01_{HASHES[kind]}"})


async def listened(endpoint, do, enough, domain=0, timeout=30):
    """Samples by absolute topic that a pyzeros node receives while `do` runs, until `enough` of them."""
    from pyzeros.sub import RawSub

    session, got = client(endpoint), {}
    node = pyzeros.Node("independent", session=session, domain_id=domain)
    subscriptions = [
        RawSub(
            stand_in(topic.kind),
            name,
            lambda sample, name=name: got.setdefault(name, []).append(sample),
            session=node,
        )
        for name, topic in ABSOLUTE.items()
    ]
    try:
        deadline = time.monotonic() + timeout
        while not enough(got) and time.monotonic() < deadline:
            await asyncio.to_thread(do)
            await asyncio.sleep(0.1)
    finally:
        for subscription in subscriptions:
            subscription.close()
        node.close()
        session.close()
    return got


def everything_received(folder):
    """Samples by absolute topic of one burst, its events, and the graph's tokens."""
    told = events()
    with ros_rig(folder) as (endpoint, sink):

        def do():
            for event in told:
                sink.take(event)

        samples = asyncio.run(listened(endpoint, do, lambda got: len(got) == len(ABSOLUTE)))
        tokens = graph(endpoint)
    return samples, told, tokens


def graph(endpoint):
    with client(endpoint, "client") as session:
        return [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**", timeout=3)]


def decoded(samples, topic, index=-1):
    """By rosbags; images also as (H, W)."""
    name = ROS_TOPICS[topic].full("/lidarboost")
    return RosTypes()._store.deserialize_cdr(samples[name][index].payload.to_bytes(), ROS_TOPICS[topic].kind)


def pixels(message):
    kind = {"32FC1": "<f4", "mono16": "<u2"}[message.encoding]
    assert message.step == message.width * np.dtype(kind).itemsize
    return message.data.view(kind).reshape(message.height, message.width)
