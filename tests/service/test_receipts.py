"""Latency up to the hands of a subscriber, and frames thinned out for links that cannot carry them all."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from publishing import publishing

from drivers import Frame
from drivers.calibration import Mount
from service.messages.events import FrameCaptured, MapFused
from service.messages.map import FusedMap
from service.sinks.publisher import Publisher
from service.wire.addresses import DEFAULT_PREFIX
from service.wire.client import Client
from service.wire.session import open_session


def with_latency(result: FusedMap, seconds: float) -> FusedMap:
    return replace(result, report=result.report.model_copy(update={"latency": seconds}))


def wait_until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


def test_a_client_that_sends_receipts_is_shown_with_its_latency(
    endpoint: str, fused: Callable[[int], FusedMap]
) -> None:
    with (
        open_session([endpoint]) as session,
        publishing(session) as publisher,
        Client(endpoint, receipts=True) as eager,
        Client(endpoint) as silent,
    ):
        depth, other = eager.subscribe("fused/depth"), silent.subscribe("fused/depth")
        for number in range(3):
            publisher.take(MapFused(with_latency(fused(number), 4.0), None))
            assert depth.receive(10).timestamp == fused(number).frame.timestamp
            other.receive(10)
        wait_until(lambda: bool(publisher.subscribers))
        (shown,) = publisher.subscribers
        assert shown.topic == "fused/depth"
        assert "@" in shown.who
        assert 4.0 < shown.latency <= shown.slowest < 14.0
        assert shown.seconds < 10
        for payload in (b"\xff", b"[]", b'{"who": "x", "topic": "y", "timestamp": 5}', b"{" * 100_000):
            eager._session.put(f"{DEFAULT_PREFIX}/receipt/x", payload)
        eager._session.put(
            f"{DEFAULT_PREFIX}/receipt/x", f'{{"who":"x","topic":"y","timestamp":{fused(0).frame.timestamp}}}'
        )
        wait_until(lambda: len(publisher.subscribers) == 2)


def test_raw_frames_are_thinned_out_whole_while_maps_pass(
    endpoint: str, fused: Callable[[int], FusedMap], monkeypatch: pytest.MonkeyPatch
) -> None:
    published: list[str] = []
    with open_session([endpoint]) as session:
        publisher = Publisher(session, raw_rate=2.0)
        now = [0.0]
        assert publisher._frames is not None
        publisher._frames._clock, publisher._frames._at = (lambda: now[0]), 0.0
        publisher.open()
        monkeypatch.setattr(publisher, "_put", lambda _, message: published.append(message.topic))
        counts = np.full((4, 6), 20_000, np.uint16)
        for number in range(100):  # two seconds of 50 frames a second
            now[0] = number / 50
            frame = Frame(counts, counts, number, number, 0.0, 0.0, 0.005, 20e6, 7.5)
            publisher.take(FrameCaptured(frame, Mount()))
        publisher.take(MapFused(fused(1), None))
        publisher.close()
    kept = {topic: published.count(topic) for topic in published}
    for topic in ("camera/distance", "camera/amplitude", "camera/frame", "stage/transform"):
        assert kept[topic] == 4, kept
    assert kept["fused/depth"] == 1
