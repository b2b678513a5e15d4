"""Messages: public schemas, exact content, and geometry as REP 103 has it."""

import json

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from made_frames import START, make_frame
from pydantic import BaseModel

from drivers import RecordingError, sr3000_calibration, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import (
    calibration_message,
    decode_image,
    frame_messages,
    image_message,
    json_message,
)


def _transform(frame, mount):
    message = FrameTransform.FromString(frame_messages(frame, mount)[3].payload)
    q = message.rotation
    t = message.translation
    return message, np.array([q.x, q.y, q.z, q.w]), np.array([t.x, t.y, t.z])


def _turned(quaternion, vector):
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(quaternion).apply(vector)


def test_frame_becomes_four_messages_with_its_time_and_counter():
    frame = make_frame(7)
    messages = frame_messages(frame, Mount())
    assert [(m.topic, m.schema.name, m.message_encoding) for m in messages] == [
        ("camera/distance", "foxglove.RawImage", "protobuf"),
        ("camera/amplitude", "foxglove.RawImage", "protobuf"),
        ("camera/frame", "lidarboost.Frame", "json"),
        ("stage/transform", "foxglove.FrameTransform", "protobuf"),
    ]
    assert {(m.publish_time, m.sequence) for m in messages} == {(frame.timestamp, 107)}
    image = RawImage.FromString(messages[0].payload)
    assert (image.encoding, image.frame_id, image.step) == ("16UC1", "camera", 352)
    assert image.timestamp.ToNanoseconds() == frame.timestamp
    assert image.data == frame.counts.astype("<u2").tobytes()
    said = json.loads(messages[2].payload)
    assert said["timestamp"] == frame.timestamp
    assert (said["pan"], said["tilt"]) == (frame.pan, frame.tilt)
    assert said.keys() == json.loads(messages[2].schema.data)["properties"].keys()


def test_protobuf_schema_is_a_whole_descriptor_set():
    schema = image_message("x", np.zeros((2, 2), np.uint16), "mono16").schema
    files = FileDescriptorSet.FromString(schema.data).file
    assert {"google/protobuf/timestamp.proto"} < {file.name for file in files}


def test_camera_at_rest_looks_along_x_of_the_rig():
    message, quaternion, centre = _transform(make_frame(0), Mount(lever_arm=(0.02, -0.05, 0.1)))
    assert (message.parent_frame_id, message.child_frame_id) == ("rig", "camera")
    np.testing.assert_allclose(_turned(quaternion, [0, 0, 1]), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(_turned(quaternion, [1, 0, 0]), [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(_turned(quaternion, [0, 1, 0]), [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(centre, [0.1, -0.02, 0.05], atol=1e-12)


def test_pan_turns_left_and_tilt_up():
    _, quaternion, centre = _transform(make_frame(0, pan=0.3, tilt=0.0), Mount(lever_arm=(0, 0, 0.1)))
    np.testing.assert_allclose(_turned(quaternion, [0, 0, 1]), [np.cos(0.3), np.sin(0.3), 0], atol=1e-12)
    np.testing.assert_allclose(centre, 0.1 * np.array([np.cos(0.3), np.sin(0.3), 0]), atol=1e-12)
    _, quaternion, _ = _transform(make_frame(0, pan=0.0, tilt=0.2), Mount())
    np.testing.assert_allclose(_turned(quaternion, [0, 0, 1]), [np.cos(0.2), 0, np.sin(0.2)], atol=1e-12)


@pytest.mark.parametrize(
    ("dtype", "encoding", "shape"),
    [("u2", "16UC1", (5, 7)), ("f4", "32FC1", (5, 7)), ("u1", "mono8", (3, 4)), ("u1", "rgb8", (3, 4, 3))],
)
def test_images_come_back(dtype, encoding, shape):
    array = np.random.default_rng(1).integers(0, 200, shape).astype(dtype)
    back = decode_image(image_message("x", array, encoding).payload)
    assert back.dtype == array.dtype
    np.testing.assert_array_equal(back, array)


def test_padded_rows_are_read():
    image = RawImage(width=3, height=2, encoding="mono8", step=4, data=b"abc_def_")
    np.testing.assert_array_equal(decode_image(image.SerializeToString()), [[97, 98, 99], [100, 101, 102]])


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (RawImage(width=3, height=2, encoding="bayer_rggb8", step=3, data=b"abcdef"), "'bayer_rggb8'"),
        (RawImage(width=3, height=2, encoding="mono16", step=6, data=b"abcdef"), "6 bytes, expected 12"),
        (RawImage(width=3, height=2, encoding="mono16", step=3, data=b"abcdef"), "6 bytes, expected 12"),
    ],
)
def test_odd_images_are_refused(image, said):
    with pytest.raises(RecordingError, match=said):
        decode_image(image.SerializeToString())
    with pytest.raises(RecordingError, match=r"not a foxglove\.RawImage"):
        decode_image(b"\xff\xff\xff")


def test_an_array_that_does_not_fit_its_encoding_is_refused():
    with pytest.raises(ValueError, match="expected uint16"):
        image_message("x", np.zeros((2, 2), np.float32), "16UC1")
    with pytest.raises(ValueError, match="1 channel"):
        image_message("x", np.zeros((2, 2, 3), np.uint16), "16UC1")


@pytest.mark.parametrize(
    ("lens", "model", "terms"),
    [((), "plumb_bob", 5), ((0.1, 0.2, 0, 0), "plumb_bob", 5), ((0.1,) * 8, "rational_polynomial", 8)],
)
def test_calibration_message(lens, model, terms):
    calibration = sr3000_calibration().model_copy(update={"distortion": lens})
    message = calibration_message(calibration, START, "fused/calibration", 3)
    said = CameraCalibration.FromString(message.payload)
    assert (message.topic, message.sequence, said.timestamp.ToNanoseconds()) == (
        "fused/calibration",
        3,
        START,
    )
    assert (said.width, said.height, said.frame_id) == (176, 144, "camera")
    assert list(said.K) == [200, 0, 87.5, 0, 200, 71.5, 0, 0, 1]
    assert list(said.P) == [200, 0, 87.5, 0, 0, 200, 71.5, 0, 0, 0, 1, 0]
    assert said.distortion_model == model
    assert list(said.D) == [*lens, *[0.0] * (terms - len(lens))]


def test_calibration_of_a_real_camera_keeps_its_lens():
    said = CameraCalibration.FromString(calibration_message(sr4000_calibration(), START).payload)
    assert list(said.D) == list(sr4000_calibration().distortion)


class Weather(BaseModel):
    celsius: float


def test_json_messages_carry_their_schema():
    message = json_message("weather", Weather(celsius=20.5), START, 4)
    assert (message.schema.name, message.schema.encoding) == ("lidarboost.Weather", "jsonschema")
    assert json.loads(message.payload) == {"celsius": 20.5}
    assert json.loads(message.schema.data)["properties"]["celsius"]["type"] == "number"
