"""From bytes on the wire to arrays and dictionaries."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, TypeVar

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from drivers.documents import parse_json, told
from drivers.errors import RecordingError
from drivers.messages import decode_image
from service.errors import RemoteError

_POINT_TYPES = {
    PackedElementField.UINT8: "u1",
    PackedElementField.INT8: "i1",
    PackedElementField.UINT16: "<u2",
    PackedElementField.INT16: "<i2",
    PackedElementField.UINT32: "<u4",
    PackedElementField.INT32: "<i4",
    PackedElementField.FLOAT32: "<f4",
    PackedElementField.FLOAT64: "<f8",
}

_LAST_TIME = 2**63
"""ns since the epoch; times beyond it are none."""

M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """One message of a running service.

    Attributes:
        topic: without the prefix.
        value: an array (images (H, W); points a structured (P,) with x, y, z, amplitude, deviation), a
            dictionary (JSON), else the protobuf message.
        timestamp: ns since the epoch, of the exposure; None for messages that carry none.
        intrinsics: (3, 3) camera matrix of an image, pixels, where the service told it.
        distortion: OpenCV's coefficients that go with it.
    """

    topic: str
    value: Any
    timestamp: int | None
    intrinsics: NDArray[np.float64] | None = None
    distortion: NDArray[np.float64] | None = None


def decode(topic: str, encoding: str, payload: bytes) -> Received:
    """Read a message by its encoding, such as `application/protobuf;foxglove.RawImage`.

    Raises:
        RemoteError: an encoding not known here, or bytes that are not of it.
    """
    kind, _, schema = encoding.partition(";")
    try:
        if kind == "application/json":
            return _decode_json(topic, payload)
        return _decode_protobuf(topic, schema, payload)
    except (ImportError, AttributeError, ValueError, DecodeError, RecordingError) as error:
        raise RemoteError(
            f"{topic}: cannot read what came as {encoding!r} ({error}); expected what this version sends, "
            f"so the service may be another one: install the same on both sides"
        ) from error


def read(model: type[M], received: Received) -> M:
    """A JSON message as its model: fields that are not known are passed over, those that lack get defaults.

    Raises:
        RemoteError: a field of another type than here.
    """
    try:
        return model.model_validate(received.value)
    except ValidationError as error:
        raise RemoteError(
            f"{received.topic}: what came is not what this version reads ({told(error)}); the service may be "
            "another one: install the same on both sides"
        ) from error


def _decode_json(topic: str, payload: bytes) -> Received:
    value = parse_json(payload)
    if not isinstance(value, dict):
        raise ValueError(f"a {type(value).__name__}, expected an object")
    return Received(topic, value, _time(value.get("timestamp")))


def _decode_protobuf(topic: str, schema: str, payload: bytes) -> Received:
    message: Any = message_class(schema)()
    message.ParseFromString(payload)
    timestamp = _time(message.timestamp.ToNanoseconds())
    if schema == "foxglove.RawImage":
        return Received(topic, decode_image(payload), timestamp)
    if schema == "foxglove.PointCloud":
        return Received(topic, _points(message), timestamp)
    return Received(topic, message, timestamp)


def _time(told: Any) -> int | None:
    if told is None or (type(told) is int and 0 <= told < _LAST_TIME):
        return told
    raise ValueError(f"timestamp {told!r} is no time in ns since the epoch")


@cache
def message_class(schema: str) -> type[Protobuf]:
    package, _, name = schema.partition(".")
    if package != "foxglove" or not name.isidentifier():
        raise ValueError(f"unknown schema {schema!r}")
    found: type[Protobuf] = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
    return found


def _points(cloud: Any) -> NDArray[np.void]:
    unknown = {field.type for field in cloud.fields} - _POINT_TYPES.keys()
    if unknown or not cloud.fields:
        raise ValueError(f"points of type {unknown or 'nothing'}")
    layout = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [_POINT_TYPES[field.type] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_stride,
        }
    )
    return np.frombuffer(cloud.data, layout)
