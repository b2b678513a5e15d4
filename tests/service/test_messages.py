import json
import logging
from collections.abc import Callable

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from drivers.messages import Message, json_message
from service.messages.encoding import fused_messages, log_message
from service.messages.map import FusedMap
from service.messages.report import BurstReport
from service.messages.status import Degraded, RecorderState, Status
from service.messages.topics import TOPICS
from service.messages.viewing import points_message


def by_topic(result: FusedMap) -> dict[str, Message]:
    return {message.topic: message for message in fused_messages(result)}


def image(message: Message) -> np.ndarray:
    raw = RawImage.FromString(message.payload)
    assert (raw.encoding, raw.step, raw.frame_id) == ("32FC1", raw.width * 4, "fused")
    return np.frombuffer(raw.data, "<f4").reshape(raw.height, raw.width)


def test_depth_is_metric_and_unknown_pixels_are_nan(fused: Callable[[int], FusedMap]) -> None:
    result = fused(1)
    depth = image(by_topic(result)["fused/depth"])
    assert depth.shape == (72, 88)
    assert np.isnan(depth[:16, :16]).all()
    assert np.isfinite(depth[40:, 40:]).all()
    distance = result.distance[40:, 40:]
    rows, columns = np.indices(depth.shape, dtype=np.float64)[:, 40:, 40:]
    K = result.intrinsics
    length = np.sqrt(1 + ((columns - K[0, 2]) / K[0, 0]) ** 2 + ((rows - K[1, 2]) / K[1, 1]) ** 2)
    np.testing.assert_allclose(depth[40:, 40:], distance / length, rtol=1e-6)


def test_deviation_is_that_of_the_depth(fused: Callable[[int], FusedMap]) -> None:
    result = fused(1)
    messages = by_topic(result)
    deviation, depth = image(messages["fused/deviation"]), image(messages["fused/depth"])
    known = np.isfinite(depth)
    np.testing.assert_allclose(
        deviation[known] / result.deviation[known], depth[known] / result.distance[known], rtol=1e-5
    )


def test_every_message_has_the_time_of_the_reference_frame_and_the_schema_of_the_table(
    fused: Callable[[int], FusedMap],
) -> None:
    result = fused(3)
    for message in [*fused_messages(result), points_message(result)]:
        assert message.publish_time == result.frame.timestamp
        assert message.sequence == 3
        assert message.schema.name == TOPICS[message.topic].schema
    cloud = PointCloud.FromString(points_message(result).payload)
    assert cloud.timestamp.ToNanoseconds() == result.frame.timestamp
    assert cloud.frame_id == "fused"


def test_calibration_is_that_of_the_fused_image_and_comes_first(fused: Callable[[int], FusedMap]) -> None:
    message = fused_messages(fused(1))[0]
    calibration = CameraCalibration.FromString(message.payload)
    assert (calibration.width, calibration.height) == (88, 72)
    np.testing.assert_allclose(calibration.K, [400, 0, 43.5, 0, 400, 35.5, 0, 0, 1])


def test_points_lie_where_the_depth_says(fused: Callable[[int], FusedMap]) -> None:
    result = fused(1)
    cloud = PointCloud.FromString(points_message(result).payload)
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "amplitude", "deviation"]
    values = np.frombuffer(cloud.data, "<f4").reshape(-1, 5)
    known = np.isfinite(result.depth)
    assert len(values) == known.sum()
    np.testing.assert_allclose(values[:, 2], result.depth[known], rtol=1e-6)
    np.testing.assert_allclose(
        np.linalg.norm(values[:, :3].astype(float), axis=1), result.distance[known], rtol=1e-6
    )
    np.testing.assert_allclose(values[:, 4], result.deviation[known])


def test_report_reads_back_and_without_amplitude_none_is_sent(fused: Callable[[int], FusedMap]) -> None:
    result = fused(1)
    messages = by_topic(result)
    assert BurstReport.model_validate_json(messages["fused/report"].payload) == result.report
    assert ("fused/amplitude" in messages) == (result.amplitude is not None)


@pytest.mark.parametrize(
    ("level", "expected"),
    [
        (logging.DEBUG, Log.DEBUG),
        (logging.WARNING, Log.WARNING),
        (logging.CRITICAL, Log.FATAL),
        (25, Log.INFO),
    ],
)
def test_log_records_keep_their_level_and_text(level: int, expected: int) -> None:
    record = logging.LogRecord("service.capture.rig", level, "/x/rig.py", 12, "lost %s", ("camera",), None)
    log = Log.FromString(log_message(record).payload)
    assert (log.level, log.message, log.name, log.file, log.line) == (
        expected, "lost camera", "service.capture.rig", "rig.py", 12,
    )  # fmt: skip
    assert abs(log.timestamp.ToNanoseconds() - record.created * 1e9) < 1e6


def test_names_that_are_no_text_break_neither_status_nor_log() -> None:
    odd = "/data/odd-\udcff.mcap"
    faults = (Degraded(what=f"{odd}: the disk is full"),)
    told = Status(recorder=RecorderState(file=odd), degraded=faults, latency=float("inf"))
    read = json.loads(json_message("status", told, 0).payload)
    whole = "/data/odd-\N{REPLACEMENT CHARACTER}.mcap"
    assert (read["recorder"]["file"], read["degraded"][0]["what"]) == (whole, f"{whole}: the disk is full")
    assert read["latency"] is None
    assert Status.model_validate(read).recorder is not None
    record = logging.LogRecord("service", logging.INFO, "f.py", 1, "wrote %s", (odd,), None)
    assert Log.FromString(log_message(record).payload).message == f"wrote {whole}"
