"""Bags that are not as they should be: one clear line, or what can be saved."""

import numpy as np
import pytest
from made_bags import PERIOD, START, Ros, amplitude_image, depth_bag, depth_image

from drivers.depth.reading import DepthReading
from drivers.errors import NotAvailableError, RecordingError
from drivers.importers import ImportOptions, import_frames

DISTANCE = ImportOptions(reading=DepthReading(kind="distance"))


def imported(paths, options=DISTANCE, **changes):
    found = import_frames(paths, options.model_copy(update=changes))
    return found.findings, list(found.frames())


def test_the_kind_must_be_told(tmp_path):
    with pytest.raises(RecordingError, match=r"--kind depth or --kind distance"):
        imported([depth_bag().save(tmp_path / "bag")], ImportOptions())


def test_without_camera_information_it_says_how_to_give_it(tmp_path):
    bag = Ros()
    bag.image(depth_image(), START)
    with pytest.raises(RecordingError, match=r"no camera information.*--camera-info.*--calibration"):
        imported([bag.save(tmp_path / "bag")])


def test_a_camera_that_is_not_calibrated_is_refused(tmp_path):
    bag = Ros()
    bag.info(k=(0.0,) * 9)
    bag.image(depth_image(), START)
    with pytest.raises(RecordingError, match=r"camera_info: says that the camera is not calibrated"):
        imported([bag.save(tmp_path / "bag")])


def test_of_two_cameras_one_must_be_named(tmp_path):
    bag = depth_bag(count=2)
    bag.info(topic="/left/camera_info")
    bag.image(depth_image(7), START, "/left/image_rect")
    path = bag.save(tmp_path / "bag")
    with pytest.raises(RecordingError, match=r"/camera/depth/image_raw, /left/image_rect; name one.*--topic"):
        imported([path])
    _, frames = imported([path], topic="left/image_rect")
    assert len(frames) == 1
    with pytest.raises(RecordingError, match=r"no image topic is called 'right'; there are"):
        imported([path], topic="right")


def test_images_without_depth_are_listed(tmp_path):
    bag = Ros()
    bag.info()
    bag.image(amplitude_image(), START, "/camera/ir", "mono16")
    with pytest.raises(RecordingError, match=r"no topic holds depth.*/camera/ir \(mono16\)"):
        imported([bag.save(tmp_path / "bag")])


def test_images_of_another_size_are_left_out(tmp_path):
    bag = depth_bag(count=2)
    bag.image(depth_image(shape=(20, 30)), START + 5 * PERIOD)
    findings, frames = imported([bag.save(tmp_path / "bag")])
    assert [frame.sequence for frame in frames] == [0, 1]
    assert any("20 × 30" in line and "40 × 56" in line for line in findings.lost)
    assert "1 of 3 frames were left out for that" in findings.lost


def test_images_out_of_order_are_put_in_order(tmp_path):
    bag = Ros()
    bag.info()
    for place, number in enumerate((2, 0, 1, 3)):
        bag.image(depth_image(number), START + number * PERIOD, at=START + place * PERIOD)
    findings, frames = imported([bag.save(tmp_path / "bag")])
    assert [frame.timestamp for frame in frames] == [START + k * PERIOD for k in range(4)]
    assert [round(frame.distance[5, 5] * 1000) for frame in frames] == [
        int(depth_image(k)[5, 5]) for k in range(4)
    ]
    assert any("2 images out of order" in note for note in findings.notes)


def test_images_stamped_0_have_the_times_of_the_log(tmp_path):
    bag = Ros()
    bag.info()
    for number in range(3):
        bag.image(depth_image(number), 0, at=START + number * PERIOD)
    findings, frames = imported([bag.save(tmp_path / "bag")])
    assert [frame.timestamp for frame in frames] == [START + k * PERIOD for k in range(3)]
    assert any("3 images are stamped 0" in note for note in findings.notes)


def test_stamps_of_another_clock_are_moved_to_the_log(tmp_path):
    bag = Ros()
    bag.info()
    for number in range(3):
        bag.image(depth_image(number), 5 * 10**9 + number * PERIOD, at=START + number * PERIOD)
    findings, frames = imported([bag.save(tmp_path / "bag")])
    assert [frame.timestamp for frame in frames] == [START + k * PERIOD for k in range(3)]
    assert any("another clock" in note for note in findings.notes)


def test_two_images_of_one_time_count_once(tmp_path):
    bag = depth_bag(count=2)
    bag.image(depth_image(9), START)
    findings, frames = imported([bag.save(tmp_path / "bag")])
    assert len(frames) == 2
    assert any("time of another" in line for line in findings.lost)


def test_depth_without_amplitude_of_its_time_is_left_out(tmp_path):
    bag = depth_bag(count=3)
    light = "/camera/amplitude/image_raw"
    bag.image(amplitude_image(0), START + PERIOD // 4, light, "mono16")  # a little late
    bag.image(amplitude_image(2), START + 2 * PERIOD, light, "mono16")
    findings, frames = imported([bag.save(tmp_path / "bag")], amplitude=light)
    assert [frame.timestamp for frame in frames] == [START, START + 2 * PERIOD]
    np.testing.assert_array_equal(frames[0].amplitude, amplitude_image(0))
    assert "1 depth images have no amplitude image of their time" in findings.lost


@pytest.mark.parametrize("told", ["16UC1; compressedDepth zpng9", "h264", "16UC1; jpeg compressed "])
def test_a_compression_that_cannot_be_read_is_named(tmp_path, told):
    bag = depth_bag(count=1)
    bag.compressed(b"\0" * 40, told, START, "/packed/image/compressed")
    findings, frames = imported([bag.save(tmp_path / "bag")], topic="/packed/image/compressed")
    assert frames == []
    assert any(told.split()[-1].strip() in line for line in findings.lost)


def test_a_torn_file_among_good_ones_is_told_and_the_others_are_read(tmp_path):
    paths = []
    for number in range(3):
        bag = Ros()
        bag.info()
        for k in range(2):
            bag.image(depth_image(), START + (2 * number + k) * PERIOD)
        (path,) = bag.save(tmp_path / f"bag{number}").glob("*.mcap")
        paths.append(path)
    whole = paths[1].read_bytes()
    paths[1].write_bytes(whole[: len(whole) // 2])
    findings, frames = imported(paths)
    assert {frame.timestamp for frame in frames} >= {START + k * PERIOD for k in (0, 1, 4, 5)}
    assert any(str(paths[1]) in line for line in findings.lost)
    paths[1].write_bytes(b"no bag at all")
    findings, frames = imported(paths)
    assert len(frames) == 4
    assert any("is not MCAP" in line for line in findings.lost)


@pytest.mark.parametrize(("name", "kind"), [("x.db3", "ros2_jazzy"), ("x.bag", "ros1_noetic")])
def test_a_torn_bag_is_one_line(tmp_path, name, kind):
    if kind == "ros1_noetic":
        whole = depth_bag(kind).save(tmp_path / "whole.bag").read_bytes()
    else:
        (file,) = depth_bag(kind).save(tmp_path / "bag", "sqlite3").glob("*.db3")
        whole = file.read_bytes()
    torn = tmp_path / name
    for content in (whole[: len(whole) // 2], b"garbage", b""):
        torn.write_bytes(content)
        with pytest.raises(RecordingError, match=r"cannot be read as a bag to its end|no topic holds depth"):
            imported([torn])


def test_a_recording_of_this_program_is_told_from_a_bag(tmp_path):
    from made_frames import make_bursts
    from made_recordings import write

    path = write(tmp_path / "own.mcap", make_bursts(1, 2))
    with pytest.raises(RecordingError, match="is a recording of this program"):
        imported([path])


def test_a_folder_without_bag_is_named(tmp_path):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    with pytest.raises(RecordingError, match="holds no file of a bag"):
        imported([tmp_path])


def test_a_library_that_is_not_there_is_named_with_the_line_that_installs_it(tmp_path, monkeypatch):
    import sys

    path = depth_bag("ros1_noetic").save(tmp_path / "x.bag")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(NotAvailableError, match=r"pip install 'lidarboost\[import\]'"):
        imported([path])
