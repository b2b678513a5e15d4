"""From bytes on the wire to arrays and dictionaries."""

import json
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.messages import decode_image
from service.errors import RemoteError


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
            value = json.loads(payload)
            return Received(topic, value, value.get("timestamp"))
        message = _message_class(schema)()
        message.ParseFromString(payload)
        timestamp: int = message.timestamp.ToNanoseconds()  # type: ignore[attr-defined]
        if schema == "foxglove.RawImage":
            return Received(topic, decode_image(payload), timestamp)
        if schema == "foxglove.PointCloud":
            return Received(topic, _points(message), timestamp)
        return Received(topic, message, timestamp)
    except (ImportError, AttributeError, ValueError, DecodeError, RecordingError) as error:
        raise RemoteError(
            f"{topic}: cannot read what came as {encoding!r} ({error}); expected what this version sends, "
            f"so the service may be another one: install the same on both sides"
        ) from error


@cache
def _message_class(schema: str) -> type[Protobuf]:
    package, _, name = schema.partition(".")
    if package != "foxglove":
        raise ValueError(f"unknown schema {schema!r}")
    found: type[Protobuf] = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
    return found


def _points(cloud: Any) -> NDArray[np.void]:
    layout = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": ["<f4"] * len(cloud.fields),
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_stride,
        }
    )
    return np.frombuffer(cloud.data, layout)
