"""A recording of two bursts, and its frames; a USB bus with a camera that stands in."""

from collections.abc import Callable

import pytest
from made_frames import make_bursts
from made_recordings import write
from usb_standin import StandIn

from drivers import sr4000_calibration
from drivers.clock import VirtualClock
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
