"""A recording of two bursts, and its frames; a USB bus with a camera that stands in; scenes rendered once."""

from collections.abc import Callable

import pytest
from made_frames import make_bursts
from made_recordings import write
from usb_standin import StandIn

import drivers.simulated
from drivers import sr4000_calibration
from drivers.clock import VirtualClock
from drivers.simulation.render import Renderer
from drivers.usb import discovery


@pytest.fixture(scope="module")
def frames():
    return make_bursts(2, 15)


@pytest.fixture(scope="module")
def whole(frames, tmp_path_factory):
    return write(tmp_path_factory.mktemp("recording") / "whole.mcap", frames, sr4000_calibration())


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(1_000_000_000)


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch, clock: VirtualClock) -> Callable[..., StandIn]:
    def plug(*args: object, **options: object) -> StandIn:
        stand_in = StandIn(*args, clock=clock, **options)
        monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
        return stand_in

    return plug


@pytest.fixture(scope="module")
def rendered_once():
    """Cameras alike share what is rendered, a second of work each."""
    known = {}

    def renderer(scene, calibration):
        key = scene.name, calibration.mount, calibration.footprint
        return known.setdefault(key, Renderer(scene, calibration))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drivers.simulated, "Renderer", renderer)
        yield
