"""A stage that reports success but turns otherwise: what the images show is told within one burst."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "service"))

from commanding import Running, configuration, running
from rig_process import free_endpoint

from drivers.backends import make_camera
from drivers.clock import SystemClock
from drivers.position import Position
from drivers.simulation.stage import SimulatedStage, StageOptions
from service.capture.rig import Rig
from service.messages.events import MapFused

pytestmark = pytest.mark.faults


class LyingStage(SimulatedStage):
    """Reports what it was told, and turns its head as `gains` (pan, tilt) say."""

    gains = 1.0, 1.0

    def pose_at(self, timestamp: int) -> Position:
        true = super().pose_at(timestamp)
        return Position(self.gains[0] * true.pan, self.gains[1] * true.tilt)


def rig_of(scene: str) -> tuple[Rig, LyingStage]:
    clock = SystemClock()
    stage = LyingStage(StageOptions(speed=1000.0), clock)
    camera = make_camera("simulated", {"scene": scene}, clock)
    return Rig(camera, stage, clock), stage


def words(service: Running) -> list[str]:
    assert service.daemon is not None
    return [fault.what for fault in service.daemon.states.degraded]


def maps_until(service: Running, true: Callable[[], bool], most: int) -> None:
    """Wait until something is true, `most` maps long."""
    before = len(service.of(MapFused))
    service.wait(lambda: true() or len(service.of(MapFused)) - before > most, 120)
    assert true(), (words(service), service.of(MapFused)[-1].map.report.motion)


FUSION = {"method": "nearest", "frames": 8, "register_poses": True}


@pytest.mark.parametrize(
    ("start", "gains", "said"),
    [
        ("scan", (0.0, 0.0), "turns in pan, but the images show no motion"),
        ("stream", (1.0, -1.0), "turns in tilt, but the images show that it turns the wrong way"),
    ],
)
def test_what_the_images_show_is_told_within_a_burst_and_ends(
    tmp_path: Path, start: str, gains: tuple[float, float], said: str
) -> None:
    rig, stage = rig_of("wedges")
    settings = configuration(
        tmp_path, free_endpoint(), start=start, fusion=FUSION, plan={"span": 2.0}, stream={"window": 8}
    )
    window = 8 if start == "stream" else 1
    with running(settings, rig, "starting") as service:
        service.wait(lambda: len(service.of(MapFused)) >= window + 2, 240)
        assert words(service) == []
        stage.gains = gains
        # The burst at work began before; the one after it is the first that shows all of it.
        maps_until(service, lambda: any(said in one for one in words(service)), 2 * window + 2)
        stage.gains = 1.0, 1.0
        maps_until(service, lambda: words(service) == [], 3 * window + 2)
