"""The plain USB camera against a stand-in behind pyusb; faults are injected on the bus."""

import errno
import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import usb.core
from usb_standin import SR2_IDS, SR3000_IDS, SR4000_IDS, StandIn, scene

from drivers.clock import VirtualClock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    NotAvailableError,
    OperationError,
)
from drivers.importers import ImportOptions, import_frames
from drivers.recording import open_recording
from drivers.settings import CameraSettings
from drivers.usb import UsbCamera, discovery
from drivers.usb.order import OrderCheck, rolled_at
from drivers.usb.profile import FOLDER, Profile, shipped_profiles
from drivers.usb.steps import Control, RegisterWrite, Write

ROOT = Path(__file__).parents[2]


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


def camera(clock: VirtualClock, **options: object) -> UsbCamera:
    return UsbCamera(UsbCamera.Options(**{"allow_inferred": True, **options}), clock)


def started(clock: VirtualClock, **options: object) -> UsbCamera:
    opened = camera(clock, **options)
    opened.open()
    opened.start()
    return opened


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


@pytest.mark.parametrize(
    "fault", ["short", "garbage", "half-garbage", "constant", "eio", "silent", "delayed"]
)
def test_a_bad_frame_is_one_drop_and_the_next_is_good(bus, clock, fault):
    bus(faults={2: fault})
    with started(clock) as cam:
        assert cam.grab().sequence == 1
        with pytest.raises(OperationError):
            cam.grab(timeout=0.5)
        if fault == "delayed":  # it comes after the driver has given up, and must not be taken for the next
            clock.sleep(2)
        frame = cam.grab()
    # the third was asked for to see the line fall silent behind it
    sent = np.frombuffer(scene(144, 176, 4), "<u2").reshape(2, 144, 176)
    assert frame.sequence == 3
    np.testing.assert_array_equal(frame.counts, sent[0])


def test_a_frame_in_two_parts_is_joined(bus, clock):
    bus(faults={1: "late"})
    with started(clock) as cam:
        frame = cam.grab()
    sent = np.frombuffer(scene(144, 176, 1), "<u2").reshape(2, 144, 176)
    np.testing.assert_array_equal(frame.amplitude, sent[1])


@pytest.mark.parametrize(
    "fault", ["stall", "refused", "stall queued", "refused exposed", "doubled", "exposed twice"]
)
def test_no_answer_is_taken_for_that_of_a_later_request(bus, clock, fault):
    """Pictures follow their requests, however many frames lie in the queue."""

    def numbered(number):
        return (4 * number).to_bytes(2, "little") + scene(144, 176, 1)[2:]

    stand_in = bus(faults={2: fault}, frames=numbered, number_by_exposure=True)
    with started(clock) as cam:
        cam.grab()
        for _ in range(4):
            clock.sleep(0.1)
            asked = clock.now()
            number = int(cam.grab().counts[0, 0]) // 4
            assert stand_in.exposures[number][0] >= asked


def test_a_stall_is_cleared_and_tried_once_more_and_counts_as_a_drop(bus, clock):
    stand_in = bus(faults={1: "stall"})
    with started(clock) as cam:
        frame = cam.grab()
    assert frame.sequence == 2
    assert stand_in.triggers == 3  # one of them to see the line fall silent behind it
    assert stand_in.events.count("clear halt") == 1


def test_a_frame_later_than_any_silence_comes_before_the_answer_to_a_later_request(bus, clock):
    stand_in = bus(faults={1: "delayed 1.5"})
    with started(clock) as cam:
        with pytest.raises(OperationError):
            cam.grab(timeout=0.1)
        clock.sleep(1.2)  # it comes while one waits for the answer to the second request, and before it
        asked = clock.now()
        cam.grab(timeout=0.5)
    assert stand_in.exposures[stand_in.triggers][0] >= asked
    assert stand_in.triggers == 3
    assert stand_in.queue == []


def test_a_camera_that_sends_by_itself_gives_no_frame_that_it_held_back(bus, clock, tmp_path):
    text = (FOLDER / "sr4000.toml").read_text()
    start, end = text.index("[[trigger.value]]"), text.index("[finish]")
    text = text[:start] + text[end:]
    (tmp_path / "mine.toml").write_text(text.replace("[trigger]", "[trigger]\nvalue = []"))

    def numbered(number):
        return (4 * number).to_bytes(2, "little") + scene(144, 176, 1)[2:]

    stand_in = bus(frames=numbered, streams=True, period=0.05)
    with started(clock, profile=tmp_path / "mine.toml") as cam:
        for pause in (0.0, 0.0, 0.01, 0.1, 1.0, 0.0, 5.0):
            clock.sleep(pause)
            frame = cam.grab()
            began, ended = stand_in.exposures[int(frame.counts[0, 0]) // 4]
            assert cam.exposure_start(frame) <= began
            assert abs(frame.timestamp - (began + ended) // 2) <= frame.timestamp_uncertainty
            assert clock.now() - began < 0.3e9


def test_a_camera_that_does_not_fall_silent_is_told(bus, clock):
    stand_in = bus()
    with started(clock) as cam:
        cam.grab()
        stand_in.queue += [(0, bytes(101376))] * 40
        with pytest.raises(OperationError, match="does not fall silent"):
            cam.grab()


def test_a_frame_is_not_asked_for_when_no_time_is_left_for_it(bus, clock):
    stand_in = bus(SR2_IDS, shape=(160, 124), planes=3, bulk_in=0x88)
    with started(clock, model="SR2B") as cam:
        cam.grab()
        asked, sequence = stand_in.triggers, cam.grab().sequence
        for _ in range(6):
            with pytest.raises(DeviceTimeoutError, match="shorter than an exposure"):
                cam.grab(timeout=0.03)  # four times 10 ms
        assert stand_in.triggers == asked + 1
        assert cam.grab().sequence == sequence + 1


def test_the_first_frame_after_other_settings_is_thrown_away(bus, clock):
    stand_in = bus(SR2_IDS, shape=(160, 124), planes=3, bulk_in=0x88)
    with started(clock, model="SR2B") as cam:
        first = cam.grab()
        assert stand_in.triggers == 2  # what was set before is not known
        cam.settings = cam.settings
        assert cam.grab().sequence == first.sequence + 1
        assert stand_in.triggers == 3
        cam.settings = cam.settings.model_copy(update={"integration_time": 4e-3})
        frame = cam.grab()
        assert stand_in.triggers == 5
        assert frame.sequence == first.sequence + 2  # nothing was lost
        sent = np.frombuffer(scene(160, 124, 5, 3), "<u2").reshape(3, 160, 124)
        np.testing.assert_array_equal(frame.counts, sent[0])


@pytest.mark.parametrize(("fault", "message"), [("rolled", "rolled frame"), ("swapped", "swapped images")])
@pytest.mark.parametrize("ids", [SR4000_IDS, SR2_IDS])
def test_rolled_and_swapped_images_are_noticed(bus, clock, fault, message, ids):
    kind = {"shape": (160, 124), "planes": 3, "bulk_in": 0x88} if ids == SR2_IDS else {}
    stand_in = bus(ids, faults={3: fault}, **kind)
    with started(clock, model="SR2B" if kind else None) as cam:
        while stand_in.triggers < 2:
            cam.grab()
        with pytest.raises(OperationError, match=message):
            cam.grab()
        assert cam.grab().valid.any()


def scenes():
    """Images of frames of one view after the other: the recordings here, and public ones where they are."""
    for path in sorted((ROOT / "recordings").glob("*.mcap")):
        yield [np.stack([f.counts, f.amplitude]) for f in islice(open_recording(path).frames(), 6)]
    for folder in sorted((ROOT.parent / "shared" / "data" / "sr4000").glob("station*")):
        frames = import_frames(sorted(folder.glob("*.dat")), ImportOptions()).frames()
        yield [np.stack([f.counts, f.amplitude]) for f in frames]


def test_frames_of_scenes_are_neither_rolled_nor_swapped_until_they_are():
    for images in scenes():
        check = OrderCheck(("distance", "amplitude"))
        for image in images:
            check.check(image)  # no false alarm
            for packets in (2, 25, 50, 98):
                assert rolled_at(np.roll(image.ravel(), -256 * packets).reshape(image.shape)) is not None
            with pytest.raises(OperationError, match="found amplitude, distance"):
                check.check(image[::-1])


def test_amplitude_above_intensity_is_told_once(caplog):
    distance, weak, strong = (np.full((160, 124), value, np.uint16) for value in (20_000, 100, 400))
    planes = ("distance", "intensity", "amplitude")
    OrderCheck(planes).check(np.stack([distance, strong, weak]))
    assert not caplog.text
    check = OrderCheck(planes)
    for _ in range(2):
        check.check(np.stack([distance, weak, strong]))
    assert caplog.text.count("may be swapped") == 1


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
