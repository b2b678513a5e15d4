"""`lidarboost devices` and `devices learn`, on a camera that stands in behind pyusb."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import usb.core
from typer.testing import CliRunner

from drivers import listing
from drivers.clock import VirtualClock
from drivers.errors import NotAvailableError
from drivers.mesasr import library
from drivers.usb import UsbCamera, discovery
from service.cli import app

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from usb_captures import USB_LINUX_MMAPPED, descriptor_request, usbmon_packets, write_pcapng
from usb_standin import (
    SR2_IDS,
    SR3000_IDS,
    SR4000_IDS,
    Firmware,
    StandIn,
)
from vendor_software import VendorSoftware


@pytest.fixture
def bus(monkeypatch):
    """Plugs in a stand-in; there is neither a vendor library nor a serial port."""
    monkeypatch.setattr(library, "FOLDERS", [])
    monkeypatch.setattr(listing, "list_serial_ports", list)

    def plug(ids=SR4000_IDS, **options):
        stand_in = StandIn(ids, clock=VirtualClock(1_700_000_000_000_000_000), **options)
        monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
        return stand_in

    return plug


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("ids", "model", "remedy"),
    [
        (SR4000_IDS, "SR4000", "allow_inferred = true"),
        (SR3000_IDS, "SR3000", "devices learn"),
        (SR2_IDS, "SR2A or SR2B", "set model to SR2A or SR2B"),
    ],
)
def test_cameras_are_listed_with_what_they_need(bus, ids, model, remedy):
    bus(ids)
    done = run("devices", "--json")
    assert done.exit_code == 0
    (found,) = json.loads(done.stdout)["devices"]
    assert (found["model"], found["serial"]) == (model, "4000002F")
    assert (found["backend"], found["where"]) == ("usb", "USB 99-4")
    assert remedy in found["remedy"]
    shown = run("devices").stdout
    assert "4000002F" in shown
    assert "Havex" in shown


def test_nothing_is_sent_by_listing(bus):
    stand_in = bus(serial=None)
    assert run("devices").exit_code == 0
    assert stand_in.log == []
    assert stand_in.events == []


def test_without_libusb_it_fails_but_lists_ports(bus, monkeypatch):
    bus()

    def missing():
        raise NotAvailableError("libusb-1.0 cannot be loaded")

    monkeypatch.setattr(discovery, "libusb", missing)
    done = run("devices")
    assert done.exit_code == 1
    assert "error: libusb-1.0 cannot be loaded" in done.stderr
    assert "Serial ports: none found" in done.stdout


def test_learn_writes_a_profile_that_the_camera_follows(bus, tmp_path):
    firmware = Firmware(uploads=(np.random.default_rng(1).bytes(70_000),), trigger=0xB9)
    stand_in = bus(SR3000_IDS, firmware=firmware)
    VendorSoftware(usb.core.find(backend=stand_in), firmware).session(10, ((9, 40), (9, 80)))
    trace, profile = tmp_path / "trace.pcapng", tmp_path / "mine.toml"
    session = [descriptor_request(SR3000_IDS, stand_in.clock.now() - 10**10), *stand_in.log]
    write_pcapng(trace, usbmon_packets(session), USB_LINUX_MMAPPED)
    done = run("devices", "learn", trace, "-o", profile, "--register", "integration_time=40,80")
    assert done.exit_code == 0, done.stderr
    assert "trigger: request 0xb9" in done.stdout
    assert "allow_inferred = true" in done.stdout
    again = run("devices", "learn", trace, "-o", profile)
    assert (again.exit_code, "exists already" in again.stderr) == (2, True)
    stand_in.power_on()
    with UsbCamera(UsbCamera.Options(profile=profile, allow_inferred=True), stand_in.clock) as camera:
        camera.start()
        assert camera.grab().integration_time == pytest.approx(16.2e-3)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["missing.pcapng"], 1, "cannot read the capture"),
        (["missing.pcapng", "--register", "colour=1"], 2, "expected integration_time or amplitude_threshold"),
        (["missing.pcapng", "--register", "integration_time=300"], 2, "takes 0 to 255"),
        (["missing.pcapng", "--register", "integration_time=a"], 2, "whole numbers"),
    ],
)
def test_learn_refuses_in_one_line(arguments, status, message):
    done = run("devices", "learn", *arguments)
    assert done.exit_code == status
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
