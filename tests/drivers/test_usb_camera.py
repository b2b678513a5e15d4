"""The plain USB camera against a stand-in behind pyusb; faults are injected on the bus."""

import errno
import re
from pathlib import Path

import numpy as np
import pytest
import usb.core
from usb_bus import camera, started
from usb_standin import SR2_IDS, SR3000_IDS, scene

from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    NotAvailableError,
    OperationError,
)
from drivers.settings import CameraSettings
from drivers.usb import discovery
from drivers.usb.profile import FOLDER, Profile, shipped_profiles
from drivers.usb.steps import Control, RegisterWrite, Write


def test_frames_arrive_bit_for_bit(bus, clock):
    stand_in = bus()
    with started(clock) as cam:
        frames = [cam.grab() for _ in range(3)]
    for number, frame in enumerate(frames, start=1):
        sent = np.frombuffer(scene(144, 176, number), "<u2").reshape(2, 144, 176)
        np.testing.assert_array_equal(frame.counts, sent[0])
        np.testing.assert_array_equal(frame.amplitude, sent[1])
    assert [frame.sequence for frame in frames] == [1, 2, 3]
    assert frames[0].ambiguity_range == 5.0
    assert stand_in.open_handles == 0
    assert not stand_in.claimed


def test_only_the_trigger_is_sent_to_an_sr4000(bus, clock):
    stand_in = bus()
    with started(clock) as cam:
        cam.grab()
    sent = [transfer for transfer in stand_in.log if transfer.kind != "read"]
    vendor = [transfer for transfer in sent if not transfer.setup or transfer.setup[0] & 0x60]
    assert [transfer.setup for transfer in vendor] == [bytes((0x40, 0xB0, 0, 0, 0, 0, 0, 0))]


@pytest.mark.parametrize(
    "step",
    [
        Control(request_type=0x40, request=0xB1),
        Control(request_type=0x40, request=0xB0, value=1),
        Control(request_type=0xC0, request=0xB0, length=64),
        Write(endpoint=2, data=b"abc"),
        RegisterWrite(number=9, value=20),
    ],
)
def test_what_the_profile_does_not_list_is_never_sent(bus, clock, step):
    stand_in = bus()
    with started(clock) as cam:
        before = len(stand_in.log)
        with pytest.raises(OperationError, match="not in the profile"):
            cam._transport.send(step)
    assert all(transfer.kind == "read" or transfer.setup for transfer in stand_in.log[before:])
    assert len(stand_in.log) == before


def test_inferred_entries_need_consent_and_nothing_is_sent_without(bus, clock):
    stand_in = bus()
    with pytest.raises(InitialisationError, match=r"allow_inferred = true"):
        camera(clock, allow_inferred=False).open()
    assert stand_in.claimed is False
    assert not [transfer for transfer in stand_in.log if transfer.setup[0] & 0x60]


def test_sr3000_says_how_to_learn_its_upload(bus, clock):
    bus(SR3000_IDS)
    with pytest.raises(InitialisationError, match=r"initialise.*devices learn"):
        camera(clock).open()


def test_sr2_works_without_consent_but_wants_its_model(bus, clock):
    stand_in = bus(SR2_IDS, shape=(160, 124), planes=3, bulk_in=0x88)
    with pytest.raises(InitialisationError, match="SR2A or SR2B"):
        camera(clock, allow_inferred=False).open()
    with started(clock, allow_inferred=False, model="SR2B") as cam:
        frame = cam.grab()
        assert frame.shape == (160, 124)
        assert stand_in.registers == {2: 0xC0, 9: 49}
        assert frame.integration_time == pytest.approx(10e-3)
        cam.settings = CameraSettings(integration_time=30.1e-3)
        assert stand_in.registers[9] == 150  # nearest to (30.1 ms - 0.2 ms) / 0.2 ms = 149.5
        assert cam.settings.integration_time == pytest.approx(30.2e-3)
        with pytest.raises(InitialisationError, match=r"takes 0\.2 to 51\.2 ms"):
            cam.settings = CameraSettings(integration_time=60e-3)
        known = cam.calibration.intrinsics
        assert (known.fx, known.fy) == pytest.approx((8e-3 / 54.8e-6, 8e-3 / 39.2e-6))
        assert (known.cx, known.cy) == (62, 80)
    with camera(clock, model="SR2A") as cam, pytest.raises(InitialisationError, match="optics"):
        _ = cam.calibration


@pytest.mark.parametrize(
    "change",
    [
        {"modulation_frequency": 20e6},
        {"integration_time": 3e-3},
        {"amplitude_threshold": 5},
        {"amplitude_mode": "gray"},
        {"frame_rate": 500.0},
    ],
)
def test_settings_whose_register_is_unknown_are_refused(bus, clock, change):
    stand_in = bus()
    with started(clock) as cam:
        in_force = cam.settings
        with pytest.raises(InitialisationError, match="SR4000 cannot be given"):
            cam.settings = in_force.model_copy(update=change)
        assert cam.settings == in_force
    assert stand_in.registers == {}


def test_a_camera_that_keeps_failing_is_lost(bus, clock):
    bus(faults=dict.fromkeys(range(1, 20), "silent"))
    with started(clock) as cam:
        for _ in range(4):
            with pytest.raises(DeviceTimeoutError):
                cam.grab(timeout=0.1)
        with pytest.raises(DeviceLostError, match="5 failed frames"):
            cam.grab(timeout=0.1)


def test_replugging_opens_the_same_camera_with_its_settings(bus, clock):
    stand_in = bus(SR2_IDS, shape=(160, 124), planes=3, bulk_in=0x88, faults={4: "unplug"})
    cam = started(clock, model="SR2B")
    cam.settings = cam.settings.model_copy(update={"integration_time": 4e-3})
    cam.grab()
    cam.grab()
    with pytest.raises(DeviceLostError, match="unplugged"):
        cam.grab()
    cam.close()
    with pytest.raises(NotAvailableError, match="no SwissRanger found"):
        cam.open()
    stand_in.replug()
    assert stand_in.registers == {}
    cam.open()
    cam.start()
    frame = cam.grab()
    cam.close()
    assert stand_in.registers == {2: 0xC0, 9: 19}
    assert cam.settings.integration_time == pytest.approx(4e-3)
    assert frame.sequence == 4  # the frame lost in unplugging is a gap
    assert stand_in.open_handles == 0


def test_permission_denied_names_the_node_and_the_rule(bus, clock):
    stand_in = bus()
    stand_in.open_errno = errno.EACCES
    with pytest.raises(NotAvailableError) as caught:
        camera(clock, serial=None).open()
    message = str(caught.value)
    assert "/dev/bus/usb/099/005" in message
    assert 'ATTR{idVendor}=="1ad2", ATTR{idProduct}=="0075", MODE="0660", GROUP="plugdev"' in message


def test_a_permission_taken_away_is_a_lost_camera(bus, clock, monkeypatch):
    stand_in = bus()
    with started(clock) as cam:
        cam.grab()

        def denied(*_):
            raise usb.core.USBError("Access denied", -3, errno.EACCES)

        monkeypatch.setattr(stand_in, "bulk_read", denied)
        with pytest.raises(DeviceLostError, match="no permission"):
            cam.grab()


def test_listing_leaves_no_handle_open(bus):
    stand_in = bus()
    assert [device.serial for device in discovery.find_cameras()] == ["4000002F"]
    assert stand_in.open_handles == 0


def test_a_camera_in_use_is_not_available(bus, clock):
    stand_in = bus()
    stand_in.claim_errno = errno.EBUSY
    with pytest.raises(NotAvailableError, match="another program"):
        camera(clock).open()
    assert stand_in.open_handles == 0


def test_kernel_driver_is_detached_and_attached_again(bus, clock):
    stand_in = bus()
    stand_in.kernel_driver = True
    with started(clock) as cam:
        cam.grab()
        assert stand_in.kernel_driver is False
    assert stand_in.events == ["detach", "claim", "release", "attach"]


def test_wrong_endpoints_are_told(bus, clock):
    stand_in = bus(bulk_in=0x84)
    with pytest.raises(InitialisationError, match=r"0x02, 0x84.*needs 0x86"):
        camera(clock).open()
    assert stand_in.open_handles == 0


def test_unconfigured_device_is_configured(bus, clock):
    stand_in = bus()
    stand_in.configuration = 0
    with started(clock) as cam:
        cam.grab()
    assert "configuration 1" in stand_in.events


def test_serial_selects(bus, clock):
    bus()
    with camera(clock, serial="4000002F") as cam:
        assert cam.capabilities.serial == "4000002F"
        assert cam.capabilities.model == "SR4000"
    with pytest.raises(NotAvailableError, match=r"no camera with serial 1.*4000002F"):
        camera(clock, serial="1").open()


def test_timestamp_interval_holds_the_exposure(bus, clock):
    bus(period=0.05)
    with started(clock) as cam:
        cam.grab()
        before = clock.now()
        frame = cam.grab()
        after = clock.now()
    low = frame.timestamp - frame.timestamp_uncertainty
    high = frame.timestamp + frame.timestamp_uncertainty
    # unknown integration time: up to 25.8 ms; four samples, each with 4.6 ms of readout, may lie before
    requested = before + 1e6  # after a millisecond in which nothing lay ready
    assert low == pytest.approx(requested - 2 * 30.4e6, abs=2)
    assert cam.exposure_start(frame) == pytest.approx(requested - 4 * 30.4e6, abs=2)
    assert high == pytest.approx(after - 101376 / (13 * 512 * 8000) * 1e9, abs=2)


def test_frames_follow_an_absolute_schedule(bus, clock):
    bus(period=0.021)
    with started(clock) as cam:
        cam.settings = cam.settings.model_copy(update={"frame_rate": 10.0})
        stamps = [cam.grab().timestamp for _ in range(12)]
    assert np.diff(stamps[1:]) == pytest.approx(1e8)


def test_profiles_are_data_and_say_how_sure_they_are():
    for path in sorted(FOLDER.glob("*.toml")):
        profile = Profile.load(path)
        again = Profile.model_validate(profile.model_dump(mode="json", exclude_none=True))
        assert again == profile
        for _, fact in profile.required():
            assert fact.source


def test_a_profile_with_a_standard_request_is_refused(tmp_path):
    text = (FOLDER / "sr4000.toml").read_text().replace("request_type = 0x40", "request_type = 0x00")
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(InitialisationError, match="standard requests are not allowed"):
        Profile.load(tmp_path / "bad.toml")


def test_a_profile_that_calls_itself_documented_needs_consent_all_the_same(bus, clock, tmp_path):
    stand_in = bus()
    text = (FOLDER / "sr4000.toml").read_text().replace('"inferred"', '"documented"')
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InitialisationError, match=r"mine\.toml: .*allow_inferred = true"):
        camera(clock, profile=tmp_path / "mine.toml", allow_inferred=False).open()
    assert stand_in.events == []


def test_bits_that_the_model_does_not_use_are_cleared(bus, clock):
    def frames(number):
        images = np.frombuffer(scene(144, 176, number), "<u2").copy()
        return (images | 3).tobytes()

    bus(frames=frames)
    with started(clock) as cam:
        frame = cam.grab()
    assert not np.any(frame.counts & 3)
    assert np.all(frame.amplitude & 3 == 3)


def test_no_device_at_all(bus, clock):
    stand_in = bus()
    stand_in.unplug()
    with pytest.raises(NotAvailableError, match="lidarboost devices"):
        camera(clock).open()


def test_the_udev_rules_name_every_camera():
    rules = (Path(__file__).parents[2] / "deploy" / "udev" / "60-lidarboost.rules").read_text()
    ids = re.findall(r'^SUBSYSTEM=="usb", ATTR{idVendor}=="(\w+)", ATTR{idProduct}=="(\w+)"', rules, re.M)
    shipped = {(f"{i.vendor:04x}", f"{i.product:04x}") for p in shipped_profiles() for i in p.ids}
    assert len(ids) == len(shipped)
    assert set(ids) == shipped
    for line in rules.splitlines():
        assert (
            line.startswith("#") or not line or line.endswith('MODE="0660", GROUP="plugdev", TAG+="uaccess"')
        )


def test_pyusb_is_real():
    """The driver runs through pyusb itself; only its backend is replaced."""
    assert usb.core.find.__module__ == "usb.core"
