"""Bags of other depth cameras become frames: formats, units, byte order, pairs, optics, directions."""

import numpy as np
import pytest
from made_bags import (
    FRAME_ID,
    PERIOD,
    SHAPE,
    START,
    K,
    Ros,
    amplitude_image,
    depth_bag,
    depth_image,
    write_foxglove,
)

from drivers.calibration import Calibration, Intrinsics
from drivers.depth.reading import DepthReading
from drivers.importers import ImportOptions, import_frames
from drivers.recording import RecordingWriter, open_recording

DISTANCE = ImportOptions(reading=DepthReading(kind="distance"))
DEPTH = ImportOptions(reading=DepthReading(kind="depth"))


def imported(path, options=DISTANCE, burst=None):
    found = import_frames([path], options, burst)
    return found, list(found.frames())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_of_ros_2_becomes_frames(tmp_path, storage):
    found, frames = imported(depth_bag().save(tmp_path / "bag", storage))
    assert len(frames) == found.count == 4
    assert found.findings.lost == []
    assert any("millimetres" in note for note in found.findings.notes)
    for number, frame in enumerate(frames):
        assert (frame.timestamp, frame.sequence, frame.pose) == (START + number * PERIOD, number, number)
        assert frame.amplitude is None
        assert frame.ambiguity_range is None
        truth = depth_image(number).astype(np.float32) * np.float32(1e-3)
        truth[0, 0] = truth[1, 1] = np.nan
        np.testing.assert_array_equal(frame.distance, truth)
    known = found.calibration.intrinsics
    assert (known.fx, known.fy, known.cx, known.cy) == (K[0], K[4], K[2], K[5])


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_that_is_compressed_as_a_whole_or_by_message_is_read(tmp_path, storage, mode):
    _, frames = imported(depth_bag().save(tmp_path / "bag", storage, mode))
    assert [round(frame.distance[5, 5] * 1000) for frame in frames] == [
        int(depth_image(number)[5, 5]) for number in range(4)
    ]


def test_one_file_of_a_bag_and_one_of_ros_1_are_read_alike(tmp_path):
    folder = depth_bag(amplitude=True).save(tmp_path / "bag", "sqlite3")
    (alone,) = folder.glob("*.db3")
    old = depth_bag("ros1_noetic", amplitude=True).save(tmp_path / "old.bag")
    options = DISTANCE.model_copy(update={"amplitude": "camera/amplitude/image_raw"})
    for path in (alone, old):
        _, frames = imported(path, options)
        assert len(frames) == 4
        for number, frame in enumerate(frames):
            np.testing.assert_array_equal(frame.amplitude, amplitude_image(number))
            assert frame.valid.sum() == frame.counts.size - 2


def test_depth_along_the_axis_becomes_distance_along_the_ray(tmp_path):
    lens = (-0.2, 0.05, 0.001, -0.002, 0.0)
    bag = Ros()
    bag.info(d=lens)
    bag.image(depth_image(), START)
    _, (frame,) = imported(bag.save(tmp_path / "bag"), DEPTH)
    from solver.geometry.points import depth_from_distance

    depth = depth_from_distance(frame.distance, np.array(K).reshape(3, 3), np.array(lens))
    truth = depth_image().astype(float) * 1e-3
    inside = np.isfinite(frame.distance)
    assert inside.sum() == frame.counts.size - 2
    np.testing.assert_allclose(depth[inside], truth[inside], atol=2e-6)
    assert frame.distance[0, 1] > truth[0, 1] + 0.1


@pytest.mark.parametrize(("pad", "big"), [(0, True), (10, False), (6, True)])
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_padded_rows_and_swapped_bytes_are_honoured(tmp_path, pad, big, encoding):
    image = depth_image()
    if encoding == "32FC1":
        image = image.astype(np.float32) * 1e-3
        image[2, 3], image[4, 5], image[6, 7] = np.nan, np.inf, -1.0
    bag = Ros()
    bag.info()
    bag.image(image, START, encoding=encoding, pad=pad, big=big)
    _, (frame,) = imported(bag.save(tmp_path / "bag"), DISTANCE)
    scale = 1e-3 if encoding == "16UC1" else 1.0
    usable = frame.valid
    np.testing.assert_allclose(frame.distance[usable], image[usable] * np.float32(scale), rtol=1e-6)
    assert usable.sum() == image.size - (2 if encoding == "16UC1" else 4)


def test_scale_and_invalid_values_are_as_told(tmp_path):
    path = depth_bag(count=1).save(tmp_path / "bag")
    told = DepthReading(kind="distance", scale=0.25e-3, invalid=(1507.0,))
    _, (frame,) = imported(path, ImportOptions(reading=told))
    assert np.isnan(frame.distance[0, 1])
    assert frame.distance[0, 2] == pytest.approx(1514 * 0.25e-3)


def test_directions_come_from_the_transforms(tmp_path):
    from scipy.spatial.transform import Rotation

    from drivers.messages import RIG_FROM_STAGE
    from drivers.poses import relative_rotations, stage_rotation

    angles = [(0.3, -0.1), (0.304, -0.1), (0.304, -0.097), (0.296, -0.103)]
    roll = Rotation.from_euler("z", 2, degrees=True).as_matrix()  # the camera is mounted askew
    optical = Rotation.from_matrix(RIG_FROM_STAGE).as_quat()
    bag = depth_bag()
    bag.transform(START, "camera_link", FRAME_ID, optical, topic="/tf_static")
    worlds = []
    for number, place in enumerate(angles):
        in_world = RIG_FROM_STAGE @ stage_rotation(*place) @ roll
        worlds.append(in_world)
        link = Rotation.from_matrix(in_world @ RIG_FROM_STAGE.T).as_quat()
        bag.transform(START + number * PERIOD, "base", "camera_link", link, (0.0, 0.0, 1.0))
    found, frames = imported(bag.save(tmp_path / "bag"))
    assert not [note for note in found.findings.notes if "roll" in note or "move" in note]
    np.testing.assert_allclose([(f.pan, f.tilt) for f in frames], angles, atol=1e-9)
    turns = relative_rotations([(f.pan, f.tilt) for f in frames], found.calibration.mount)
    truth = [Rotation.from_matrix(worlds[0].T @ world).as_rotvec() for world in worlds]
    np.testing.assert_allclose(turns, truth, atol=1e-9)


def test_rectified_images_have_the_projection_matrix(tmp_path):
    bag = Ros()
    bag.info(d=(0.1, 0.0, 0.0, 0.0, 0.0))
    bag.image(depth_image(), START, "/camera/depth/image_rect_raw")
    found, _ = imported(bag.save(tmp_path / "bag"))
    assert found.calibration.distortion == ()
    assert found.calibration.intrinsics.fx == pytest.approx(0.9 * K[0])
    assert any("rectified" in note for note in found.findings.notes)


def test_a_part_of_the_sensor_and_merged_pixels_move_the_optics(tmp_path):
    bag = Ros()
    roi = bag.make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=8,
        y_offset=4,
        height=SHAPE[0] * 2,
        width=SHAPE[1] * 2,
        do_rectify=False,
    )
    bag.info(shape=(200, 300), roi=roi, binning_x=2, binning_y=2)
    bag.image(depth_image(), START)
    found, (frame,) = imported(bag.save(tmp_path / "bag"))
    known = found.calibration
    assert known.shape == frame.shape == SHAPE
    assert (known.intrinsics.fx, known.intrinsics.cx) == (K[0] / 2, (K[2] - 8) / 2)


def test_messages_of_foxglove_become_frames(tmp_path):
    import cv2
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

    from drivers.messages import protobuf_time

    image, messages = depth_image(), []
    lens = CameraCalibration(width=SHAPE[1], height=SHAPE[0], distortion_model="plumb_bob", K=K, D=(0.0,) * 5)
    messages.append(("/depth/calibration", lens, START))
    raw = RawImage(
        timestamp=protobuf_time(START),
        width=SHAPE[1],
        height=SHAPE[0],
        encoding="16UC1",
        step=SHAPE[1] * 2,
        data=image.tobytes(),
    )
    png = CompressedImage(
        timestamp=protobuf_time(START), format="png", data=cv2.imencode(".png", image)[1].tobytes()
    )
    messages += [("/depth/image", raw, START), ("/packed/image", png, START)]
    path = write_foxglove(tmp_path / "x.mcap", messages)
    for topic in ("/depth/image", "/packed/image"):
        _, (frame,) = imported(path, DISTANCE.model_copy(update={"topic": topic}))
        assert frame.valid.sum() == image.size - 2
        assert frame.distance[3, 4] == pytest.approx(image[3, 4] * 1e-3)


def test_a_recording_keeps_metres_and_scaled_counts_exactly(tmp_path):
    path = depth_bag(count=3).save(tmp_path / "bag")
    for options in (DISTANCE, DEPTH):
        found, frames = imported(path, options, burst=2)
        target = tmp_path / f"{options.reading.kind}.mcap"
        with RecordingWriter(target) as writer:
            writer.write_calibration(found.calibration, frames[0].timestamp)
            for frame in frames:
                writer.write_frame(frame, found.calibration.mount)
        recording = open_recording(target)
        back = list(recording.frames())
        assert [frame.burst for frame in back] == [0, 0, 1]
        assert recording.damage is None
        for one, other in zip(frames, back, strict=True):
            assert other.amplitude is None
            assert (other.scale, other.ambiguity_range) == (one.scale, None)
            np.testing.assert_array_equal(one.counts, other.counts)
        assert recording.summary().frames.amplitude_modes == ["none"]


def test_a_calibration_that_is_named_goes_before_the_bags(tmp_path):
    given = Calibration(
        width=SHAPE[1], height=SHAPE[0], intrinsics=Intrinsics(fx=40.0, fy=40.0, cx=27.0, cy=19.0)
    )
    bag = Ros()
    bag.image(depth_image(), START)
    found, frames = imported(bag.save(tmp_path / "bag"), DEPTH.model_copy(update={"calibration": given}))
    assert found.calibration == given
    assert len(frames) == 1
