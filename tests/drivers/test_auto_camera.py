"""`auto`: the first real camera, else the recording."""

import errno
from pathlib import Path

import pytest
from usb_standin import SR4000_IDS, StandIn

from drivers.backends import make_camera
from drivers.clock import VirtualClock
from drivers.errors import DeviceLostError, InitialisationError, NotAvailableError
from drivers.mesasr import library
from drivers.settings import CameraSettings
from drivers.usb import discovery

RECORDINGS = Path(__file__).parents[2] / "recordings"


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def bus(monkeypatch, clock):
    """Plugs in a stand-in; the vendor's library is not installed."""
    monkeypatch.setattr(library, "FOLDERS", [])

    def plug(ids=SR4000_IDS, **options):
        stand_in = StandIn(ids, clock=clock, **options)
        monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
        return stand_in

    return plug


@pytest.fixture(scope="module")
def recording():
    found = sorted(RECORDINGS.glob("*.mcap"))
    if not found:
        pytest.skip("no recordings here")
    return found[0]


def test_a_camera_on_usb_is_taken(bus, clock):
    bus()
    with make_camera("auto", {"allow_inferred": True}, clock) as camera:
        camera.start()
        assert camera.grab().shape == (144, 176)
        assert camera.capabilities.source == "device"
        assert camera.settings.modulation_frequency == 30e6
        assert camera.calibration.width == 176
        with pytest.raises(InitialisationError, match="cannot be given"):
            camera.settings = CameraSettings(integration_time=1e-3, modulation_frequency=30e6)


def test_without_a_camera_the_recording_is_played(bus, clock, recording, caplog):
    bus().unplug()
    with make_camera("auto", {"recording": recording}, clock) as camera:
        camera.start()
        assert camera.grab().shape == camera.calibration.shape
        assert camera.capabilities.source == "replay"
    assert "no camera found: playing the recording" in caplog.text


def test_without_either_it_says_so(bus, clock):
    bus().unplug()
    with pytest.raises(NotAvailableError, match="no recording is named"):
        make_camera("auto", {}, clock).open()


def test_a_camera_that_cannot_be_used_is_no_reason_to_play(bus, clock):
    stand_in = bus()
    stand_in.open_errno = errno.EACCES
    options = {"recording": "other.mcap", "allow_inferred": True}
    with pytest.raises(NotAvailableError, match=r"cannot be used\. usb: .*no permission"):
        make_camera("auto", options, clock).open()


def test_after_unplugging_no_recording_is_played(bus, clock, recording):
    stand_in = bus(faults={1: "unplug"})
    camera = make_camera("auto", {"recording": recording, "allow_inferred": True}, clock)
    camera.open()
    camera.start()
    with pytest.raises(DeviceLostError):
        camera.grab()
    camera.close()
    with pytest.raises(NotAvailableError):
        camera.open()
    stand_in.replug()
    with camera:
        camera.start()
        assert camera.grab().sequence == 2
        assert camera.capabilities.source == "device"
