"""How far the distance of what stands still has drifted."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from service.daemon.drift import DriftMeter
from service.messages.map import FusedMap

DEVIATION = 0.004


@pytest.fixture
def map_at(fused: Callable[[int], FusedMap]) -> Callable[..., FusedMap]:
    """Maps of one wall with noise of their own."""
    noise = np.random.default_rng(3)

    def make(number: int, offset: float = 0.0, moved: float = 0.0) -> FusedMap:
        """`moved` is the share of the rows that something else stands in."""
        found = fused(number)
        distance = (2.0 + offset + noise.normal(0, DEVIATION, found.distance.shape)).astype(np.float32)
        distance[: round(moved * len(distance))] -= 0.5
        deviation = np.full_like(distance, DEVIATION)
        return replace(found, distance=distance, deviation=deviation)

    return make


def test_a_camera_that_warms_up_is_seen_to(map_at: Callable[..., FusedMap]) -> None:
    meter = DriftMeter()
    meter.note(map_at(0))
    assert meter.latest is None
    for number in range(1, 11):
        meter.note(map_at(number, 0.002 * number))
    assert meter.latest is not None
    assert meter.latest.distance == pytest.approx(0.02, abs=5 * meter.latest.deviation)
    assert meter.latest.deviation < 0.001
    assert meter.latest.static > 0.99
    assert meter.latest.seconds == pytest.approx(10.0)


def test_what_moves_does_not_count_as_drift(map_at: Callable[..., FusedMap]) -> None:
    meter = DriftMeter()
    meter.note(map_at(0))
    meter.note(map_at(1, 0.01, moved=0.3))
    assert meter.latest is not None
    assert meter.latest.distance == pytest.approx(0.01, abs=0.002)
    assert meter.latest.static == pytest.approx(0.7, abs=0.02)


def test_another_scene_is_compared_with_itself_after_some_maps(map_at: Callable[..., FusedMap]) -> None:
    meter = DriftMeter()
    meter.note(map_at(0))
    meter.note(map_at(1, 0.01))
    before = meter.latest
    rng = np.random.default_rng(4)
    other = map_at(2)
    relief = rng.uniform(0, 3, other.distance.shape).astype(np.float32)
    for number in range(2, 6):
        meter.note(replace(map_at(number), distance=map_at(number).distance + relief))
        assert meter.latest is before
    meter.note(replace(map_at(6), distance=map_at(6).distance + relief))
    assert meter.latest is None
    meter.note(replace(map_at(7, 0.01), distance=map_at(7, 0.01).distance + relief))
    assert meter.latest is not None
    assert meter.latest.distance == pytest.approx(0.01, abs=0.002)


def test_another_pose_begins_anew(map_at: Callable[..., FusedMap]) -> None:
    meter = DriftMeter()
    meter.note(map_at(0))
    meter.note(map_at(1, 0.01))
    turned = map_at(2, 0.01)
    meter.note(replace(turned, frame=replace(turned.frame, pan=0.2)))
    assert meter.latest is None
