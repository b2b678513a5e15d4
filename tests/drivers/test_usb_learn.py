"""Learning a camera from a trace, on captures that the stand-in's own log is written to."""

from contextlib import suppress

import numpy as np
import pytest
import usb.core
from hypothesis import given, settings
from hypothesis import strategies as st
from usb_captures import (
    USB_LINUX,
    USB_LINUX_MMAPPED,
    USBPCAP,
    descriptor_request,
    descriptor_requests,
    usbmon_packets,
    usbpcap_packets,
    write_pcap,
    write_pcapng,
)
from usb_standin import SR3000_IDS, SR4000_IDS, Firmware, StandIn, Transfer, scene
from vendor_software import VendorSoftware

from drivers.clock import VirtualClock
from drivers.errors import InitialisationError, RecordingError
from drivers.usb import UsbCamera, discovery
from drivers.usb.learn import learn
from drivers.usb.profile import Profile
from drivers.usb.steps import Control, RegisterWrite, Write

PCAP = bytes.fromhex("d4c3b2a1020004000000000000000000ffff0000")
"""Start of a classic pcap file, up to its link type."""

EPOCH = 1_700_000_000_000_000_000

SETTINGS = ((9, 24), (9, 49), (9, 149), (7, 0x12), (8, 0x34))


@pytest.fixture(scope="module")
def firmware() -> Firmware:
    rng = np.random.default_rng(5)
    return Firmware(uploads=(rng.bytes(131_012), rng.bytes(69_986)), trigger=0xB7)


@pytest.fixture(scope="module")
def session(firmware: Firmware) -> list[Transfer]:
    """An SR3000 opened, ten frames, five settings with a frame after each, closed."""
    stand_in = StandIn(SR3000_IDS, firmware=firmware, clock=VirtualClock(EPOCH))
    device = usb.core.find(backend=stand_in)
    VendorSoftware(device, firmware).session(10, SETTINGS)
    return [*descriptor_requests(SR3000_IDS, EPOCH - 10**9), *stand_in.log]


def capture(path, session, kind):
    if kind == "USBPcap":
        write_pcapng(path, usbpcap_packets(session), USBPCAP, resolution=6)
    elif kind == "old USBPcap":
        write_pcapng(path, usbpcap_packets(session, old=True), USBPCAP, resolution=6)
    elif kind == "pcap":
        write_pcap(path, usbmon_packets(session), USB_LINUX_MMAPPED)
    elif kind == "big-endian":
        write_pcapng(path, usbmon_packets(session, order=">"), USB_LINUX_MMAPPED, order=">")
    else:
        link_type = int(kind)
        write_pcapng(path, usbmon_packets(session, link_type), link_type)
    return path


KINDS = ["189", "220", "USBPcap", "old USBPcap", "pcap", "big-endian"]


@pytest.mark.parametrize("kind", KINDS)
def test_every_capture_format_gives_the_same_profile(tmp_path, session, firmware, kind):
    lesson = learn(capture(tmp_path / "trace.pcapng", session, kind))
    profile = lesson.profile
    assert profile.model == "SR3000"
    assert profile.trigger.known == (Control(request_type=0x40, request=0xB7),)
    assert profile.trigger.confidence == "learned"
    assert profile.bulk_in.known == 0x86
    assert profile.image.read_bytes.known == 101376
    assert profile.finish.known == (Control(request_type=0x40, request=0xCF),)
    steps = profile.initialise.known
    uploaded = b"".join(step.data for step in steps if isinstance(step, Write))
    assert uploaded == b"".join(firmware.uploads)
    announced = [step.value for step in steps if isinstance(step, Control) and step.request == 0xC1]
    assert announced == [0, 1]
    polls = [step for step in steps if isinstance(step, Control) and step.request == 0xC2]
    assert [poll.until for poll in polls] == [b"R"]
    assert steps[-1] == RegisterWrite(number=9, value=20)
    assert any("bulk write to 0x02 × 13, 200998 bytes" in finding for finding in lesson.findings)
    assert any("register 9: 4 writes, 20, 24, 49, 149" in finding for finding in lesson.findings)
    assert "for each frame it sends: request 0xb7 (type 0x40)" in lesson.findings
    assert "trigger: precedes 14 of 14 frames" in lesson.findings
    assert profile.serial == "4000002F"
    assert "used for: the camera with the serial number 4000002F, and no other" in lesson.findings


def test_a_learned_profile_drives_the_camera(tmp_path, session, firmware, monkeypatch):
    told = {"integration_time": [24, 49, 149], "amplitude_threshold": [0x1234]}
    lesson = learn(capture(tmp_path / "trace.pcapng", session, "220"), registers=told)
    path = tmp_path / "sr3000.toml"
    path.write_text(lesson.profile.to_toml())
    assert Profile.load(path) == lesson.profile
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())  # as some editors leave it
    assert Profile.load(path) == lesson.profile
    clock = VirtualClock()
    stand_in = StandIn(SR3000_IDS, firmware=firmware, clock=clock)
    monkeypatch.setattr(discovery, "libusb", lambda: stand_in)

    with pytest.raises(
        InitialisationError, match=r"allow_inferred = true.*With it, on opening it sends: .*request 0xc1"
    ):
        UsbCamera(UsbCamera.Options(profile=path), clock).open()
    assert not [transfer for transfer in stand_in.log if transfer.setup[0] & 0x60]

    camera = UsbCamera(UsbCamera.Options(profile=path, allow_inferred=True), clock)
    camera.open()
    camera.start()
    frame = camera.grab()
    assert stand_in.is_ready
    # the first frame after settings were written is thrown away
    sent = np.frombuffer(scene(144, 176, 2), "<u2").reshape(2, 144, 176)
    np.testing.assert_array_equal(frame.counts, sent[0])
    # the last value of the trace, 149, is (149 + 1) · 0.2 ms
    assert frame.integration_time == pytest.approx(30e-3)
    camera.settings = camera.settings.model_copy(
        update={"integration_time": 5e-3, "amplitude_threshold": 0xABC}
    )
    assert stand_in.registers == {9: 24, 7: 0x0A, 8: 0xBC}
    camera.close()
    assert stand_in.log[-1].setup[:2] == bytes((0x40, 0xCF))

    # unplugged and back: everything is uploaded and set again
    stand_in.unplug()
    stand_in.replug()
    with camera:
        camera.start()
        assert camera.grab().integration_time == pytest.approx(5e-3)
    assert stand_in.registers == {9: 24, 7: 0x0A, 8: 0xBC}


def test_a_profile_is_for_its_own_camera_and_says_what_it_sends(
    tmp_path, session, firmware, monkeypatch, caplog
):
    path = tmp_path / "mine.toml"
    trace = capture(tmp_path / "trace.pcapng", session, "220")
    options = UsbCamera.Options(profile=path, allow_inferred=True)
    stand_in = StandIn(SR3000_IDS, firmware=firmware, clock=VirtualClock())
    monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
    path.write_text(learn(trace, serial="40000030").profile.to_toml())
    with pytest.raises(InitialisationError, match=r"mine\.toml is for .* 40000030.*nothing was sent"):
        UsbCamera(options, stand_in.clock).open()
    assert not [transfer for transfer in stand_in.log if not transfer.setup or transfer.setup[0] & 0x60]
    assert "it sends" not in caplog.text
    path.write_text(learn(trace).profile.to_toml())
    with UsbCamera(options, stand_in.clock):
        assert "for each frame it sends: request 0xb7 (type 0x40)" in caplog.text
    assert "bound to no serial number" not in caplog.text


def test_a_trace_without_serial_number_says_so(tmp_path, session, firmware, monkeypatch, caplog):
    lesson = learn(capture(tmp_path / "t.pcapng", [session[0], *session[2:]], "220"))
    assert lesson.profile.serial is None
    assert any("say it with --serial" in finding for finding in lesson.findings)
    path = tmp_path / "mine.toml"
    path.write_text(lesson.profile.to_toml())
    stand_in = StandIn(SR3000_IDS, firmware=firmware, clock=VirtualClock())
    monkeypatch.setattr(discovery, "libusb", lambda: stand_in)
    with UsbCamera(UsbCamera.Options(profile=path, allow_inferred=True), stand_in.clock):
        assert "bound to no serial number: it is used for any SR3000" in caplog.text


@pytest.mark.parametrize("request_number", [0xA2, 0xA9])
def test_requests_that_write_flash_are_never_learned_nor_sent(tmp_path, session, request_number):
    stamp = session[4].completed
    setup = bytes((0x40, request_number, 0, 0, 0, 0, 8, 0))
    write = Transfer("control", 0, stamp, stamp + 9, setup, sent=bytes(8), asked=8)
    told = Transfer("control", 0, stamp, stamp + 9, setup[:1] + b"\xd5" + setup[2:], sent=bytes(8), asked=8)
    for kind in ("220", "USBPcap"):
        path = capture(tmp_path / "t.pcapng", [*session[:5], write, told, *session[5:]], kind)
        lesson = learn(path)
        requests = [s.request for s in lesson.profile.initialise.known if isinstance(s, Control)]
        assert request_number not in requests
        assert any("left out: 1 requests that write the EEPROM" in finding for finding in lesson.findings)
        assert any("mind: 1 requests carry data" in finding for finding in lesson.findings)
    with pytest.raises(ValueError, match="writes the EEPROM of the camera's USB chip, and is never sent"):
        Control(request_type=0x40, request=request_number, data=bytes(8))
    assert Control(request_type=0xC0, request=request_number, length=8)  # reading it does no harm


def test_an_ambiguous_register_is_refused(tmp_path, session):
    with pytest.raises(RecordingError, match=r"no register got the values \[1, 2\]"):
        learn(capture(tmp_path / "t.pcapng", session, "220"), registers={"integration_time": [1, 2]})
    stamp = session[-2].completed
    again = Transfer("write", 0x02, stamp, stamp + 100, sent=bytes((7, 24)), asked=2)
    path = capture(tmp_path / "u.pcapng", [*session[:-1], again, session[-1]], "220")
    with pytest.raises(RecordingError, match="registers 7, 9 got"):
        learn(path, registers={"integration_time": [24]})


def test_cut_uploads_are_refused(tmp_path, session):
    write_pcapng(tmp_path / "t.pcapng", usbmon_packets(session, snap=4096), USB_LINUX_MMAPPED)
    with pytest.raises(RecordingError, match=r"4032 of 16384 bytes.*snapshot length"):
        learn(tmp_path / "t.pcapng")


def test_frames_may_be_cut_by_the_capture(tmp_path):
    sr4000 = StandIn(SR4000_IDS, clock=VirtualClock(EPOCH))
    VendorSoftware(usb.core.find(backend=sr4000)).session(5)
    log = [descriptor_request(SR4000_IDS, EPOCH - 10**9), *sr4000.log]
    write_pcapng(tmp_path / "t.pcapng", usbmon_packets(log, USB_LINUX, snap=512), USB_LINUX)
    profile = learn(tmp_path / "t.pcapng").profile
    assert profile.model == "SR4000"
    assert profile.image.read_bytes.known == 101376
    assert profile.trigger.known == (Control(request_type=0x40, request=0xB0),)


def test_other_devices_on_the_bus_are_ignored(tmp_path, session):
    disk = [
        Transfer("read", 0x81, EPOCH + n, EPOCH + n + 1, received=bytes(512), asked=512) for n in range(5000)
    ]
    others = [(s, d[:11] + bytes((9,)) + d[12:]) for s, d in usbmon_packets(disk)]  # address 9
    packets = sorted(others + usbmon_packets(session), key=lambda packet: packet[0])
    write_pcapng(tmp_path / "t.pcapng", packets, USB_LINUX_MMAPPED)
    assert learn(tmp_path / "t.pcapng").profile.image.read_bytes.known == 101376


def test_a_trace_without_descriptor_needs_the_model(tmp_path, session):
    path = capture(tmp_path / "t.pcapng", session[2:], "220")
    with pytest.raises(RecordingError, match="--model"):
        learn(path)
    assert learn(path, model="SR3000").profile.trigger.known
    with pytest.raises(RecordingError, match="no model is called 'SR9'; there are: SR2A"):
        learn(path, model="SR9")


def test_a_trace_that_began_too_late_leaves_the_upload_unknown(tmp_path, session):
    late = [transfer for transfer in session if not (transfer.kind == "write" and len(transfer.sent) > 2)]
    lesson = learn(capture(tmp_path / "t.pcapng", late, "220"))
    assert lesson.profile.initialise.confidence == "unknown"
    assert any("on opening it sends: unknown; the trace shows no upload" in f for f in lesson.findings)
    assert lesson.profile.interface.confidence == "inferred"  # no trace shows which interface was claimed


def test_failed_transfers_are_left_out(tmp_path, session):
    stall = Transfer("control", 0, session[3].completed, session[3].completed + 9,
                     bytes((0x40, 0xEE, 0, 0, 0, 0, 0, 0)), status=32)  # fmt: skip
    for kind in ("220", "USBPcap"):
        lesson = learn(capture(tmp_path / "t.pcapng", [*session[:4], stall, *session[4:]], kind))
        requests = [s.request for s in lesson.profile.initialise.known if isinstance(s, Control)]
        assert 0xEE not in requests
        assert any("left out: 1 transfers" in finding for finding in lesson.findings)


def test_three_images_a_frame_leave_their_names_open(tmp_path):
    stand_in = StandIn(SR4000_IDS, planes=3, clock=VirtualClock(EPOCH))
    VendorSoftware(usb.core.find(backend=stand_in), frame_bytes=3 * 50688).session(6)
    path = capture(tmp_path / "t.pcapng", stand_in.log, "220")
    profile = learn(path, model="SR4000").profile
    assert profile.image.planes.confidence == "unknown"
    assert "3 images" in profile.image.planes.source


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a capture", "neither a pcapng nor a pcap"),
        (b"", "neither"),
        (
            bytes.fromhex("d4c3b2a1020004000000000000000000ffff000001000000") + bytes(16),
            "link type 1, not of USB",
        ),
        (bytes.fromhex("d4c3b2a1020004000000000000000000ffff0000dc000000"), "no packets"),
    ],
)
def test_files_that_are_no_usb_capture(tmp_path, content, message):
    (tmp_path / "t.pcap").write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        learn(tmp_path / "t.pcap")


def test_a_torn_capture_is_read_as_far_as_it_goes(tmp_path, session):
    path = capture(tmp_path / "t.pcapng", session, "220")
    path.write_bytes(path.read_bytes()[:-100_000])
    assert learn(path).profile.trigger.known == (Control(request_type=0x40, request=0xB7),)


@given(
    kind=st.sampled_from(["189", "USBPcap", "pcap"]),
    cuts=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=8)), min_size=1, max_size=5),
    end=st.floats(0, 1),
)
@settings(max_examples=60, deadline=None)
def test_a_damaged_capture_never_ends_in_anything_but_a_clear_error(
    tmp_path_factory, session, kind, cuts, end
):
    path = capture(tmp_path_factory.mktemp("t") / "t.pcapng", session[:60], kind)
    content = bytearray(path.read_bytes())
    for place, data in cuts:
        start = int(place * 4000)  # where the headers are, of the file and of its first packets
        content[start : start + len(data)] = data
    path.write_bytes(content[: max(int(end * len(content)), 100)])
    with suppress(RecordingError):
        learn(path, model="SR3000")


def test_a_packet_cut_off_before_its_stage_is_read_as_far_as_it_goes(tmp_path, session):
    (at, whole), *_ = usbpcap_packets(session)
    write_pcapng(tmp_path / "t.pcapng", [(at, whole[:27])], USBPCAP)
    with pytest.raises(RecordingError, match="no device sends anything"):
        learn(tmp_path / "t.pcapng", model="SR3000")


def test_too_few_frames(tmp_path, session):
    path = capture(tmp_path / "t.pcapng", session[:-32], "220")
    with pytest.raises(RecordingError, match=r"shows \d frames of the SR3000; record one"):
        learn(path)


def test_a_camera_that_sends_by_itself_has_no_trigger(tmp_path):
    session = [
        Transfer("read", 0x86, start, start + 9000, received=bytes(101376), asked=101376)
        for start in range(EPOCH, EPOCH + 8 * 10**7, 10**7)
    ]
    profile = learn(capture(tmp_path / "t.pcapng", session, "220"), model="SR4000").profile
    assert profile.trigger.known == ()
    assert profile.image.read_bytes.known == 101376
