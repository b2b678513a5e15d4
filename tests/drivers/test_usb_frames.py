"""Frames off the bus: each the answer to its own request, and whole; faults are injected at the bus."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from usb_bus import started
from usb_standin import SR2_IDS, SR4000_IDS, scene

from drivers.errors import DeviceTimeoutError, OperationError
from drivers.importers import ImportOptions, import_frames
from drivers.recording import open_recording
from drivers.usb.order import OrderCheck, rolled_at
from drivers.usb.profile import FOLDER

ROOT = Path(__file__).parents[2]


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
