"""Events as messages: frames, maps, points, reports, status and log."""

import logging
from functools import singledispatch

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from drivers.calibration import Calibration, Intrinsics
from drivers.messages import (
    Message,
    calibration_message,
    frame_messages,
    image_message,
    json_message,
    protobuf_message,
    protobuf_time,
    transform_message,
)
from drivers.names import shown
from service.errors import EncodingError
from service.messages.events import (
    BurstCaptured,
    DevicesOpened,
    Event,
    FrameCaptured,
    Logged,
    MapFused,
    ReplayTold,
    ScanProgressed,
    StatusTold,
)
from service.messages.map import FusedMap
from service.messages.topics import (
    FUSED_AMPLITUDE,
    FUSED_CALIBRATION,
    FUSED_DEPTH,
    FUSED_DEVIATION,
    FUSED_FRAME_ID,
    FUSED_REASON,
    FUSED_REPORT,
    FUSED_TRANSFORM,
    LOG,
    REPLAY_STATE,
    SCAN_PROGRESS,
    STATUS,
)


def event_messages(event: Event) -> tuple[Message, ...]:
    """What is published and recorded of an event; encoded once, however many sinks ask.

    Raises:
        EncodingError: it cannot be encoded.
    """
    try:
        return event.once(event_messages, lambda: tuple(_messages(event)))
    except Exception as error:
        raise EncodingError(f"{type(event).__name__} cannot be encoded: {error}") from error


@singledispatch
def _messages(event: Event) -> list[Message]:  # noqa: ARG001
    return []


@_messages.register
def _(event: DevicesOpened) -> list[Message]:
    return [calibration_message(event.calibration, event.timestamp)]


@_messages.register
def _(event: FrameCaptured) -> list[Message]:
    return frame_messages(event.frame, event.mount)


@_messages.register
def _(event: BurstCaptured) -> list[Message]:
    return [calibration_message(event.burst.calibration, event.burst.reference.timestamp)]


@_messages.register
def _(event: MapFused) -> list[Message]:
    return fused_messages(event.map)


@_messages.register
def _(event: ScanProgressed) -> list[Message]:
    return [json_message(SCAN_PROGRESS, event.progress, event.progress.timestamp)]


@_messages.register
def _(event: ReplayTold) -> list[Message]:
    return [json_message(REPLAY_STATE, event.replay, event.replay.timestamp)]


@_messages.register
def _(event: StatusTold) -> list[Message]:
    return [json_message(STATUS, event.status, event.status.timestamp)]


@_messages.register
def _(event: Logged) -> list[Message]:
    return [log_message(event.record)]


def fused_messages(result: FusedMap) -> list[Message]:
    """Calibration, transform, depth, deviation, amplitude where there is one, reasons and report of a map.

    All carry the time of the reference frame. Calibration and transform come first: who has an image can ask
    for what belongs to it.
    """
    at = result.frame.timestamp, result.frame.sequence
    # Z = distance · cos(angle off the axis), and so is its standard deviation.
    with np.errstate(invalid="ignore", divide="ignore"):
        deviation = result.deviation * (result.depth / result.distance)
    messages = [
        calibration_message(fused_calibration(result), at[0], FUSED_CALIBRATION, at[1], FUSED_FRAME_ID),
        transform_message(FUSED_TRANSFORM, FUSED_FRAME_ID, result.frame, result.calibration.mount),
        image_message(FUSED_DEPTH, result.depth, "32FC1", FUSED_FRAME_ID, *at),
        image_message(FUSED_DEVIATION, deviation, "32FC1", FUSED_FRAME_ID, *at),
    ]
    if result.amplitude is not None:
        messages.append(image_message(FUSED_AMPLITUDE, result.amplitude, "32FC1", FUSED_FRAME_ID, *at))
    messages.append(image_message(FUSED_REASON, result.reason, "8UC1", FUSED_FRAME_ID, *at))
    return [*messages, json_message(FUSED_REPORT, result.report, *at)]


def fused_calibration(result: FusedMap) -> Calibration:
    """The calibration of the fused image: its intrinsics, the camera's distortion."""
    K = result.intrinsics
    rows, columns = result.depth.shape
    return Calibration(
        width=columns,
        height=rows,
        intrinsics=Intrinsics(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2]),
        distortion=result.calibration.distortion,
        source=result.calibration.source,
    )


def log_message(record: logging.LogRecord) -> Message:
    """foxglove.Log of one record of Python's logging."""
    timestamp = round(record.created * 1e9)
    message = Log(
        timestamp=protobuf_time(timestamp),
        level=_log_level(record.levelno),
        message=shown(record.getMessage()),
        name=record.name,
        file=record.filename,
        line=record.lineno,
    )
    return protobuf_message(LOG, message, timestamp)


def _log_level(level: int) -> Log.Level.ValueType:
    steps = (
        (logging.CRITICAL, Log.FATAL),
        (logging.ERROR, Log.ERROR),
        (logging.WARNING, Log.WARNING),
        (logging.INFO, Log.INFO),
    )
    return next((name for limit, name in steps if level >= limit), Log.DEBUG)
