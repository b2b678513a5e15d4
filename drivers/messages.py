"""What is recorded and published, as bytes: Foxglove protobuf messages and JSON with a schema.

The same bytes go to a recording (MCAP topic `/<topic>`) and onto the wire (Zenoh key `<prefix>/<topic>`).
Times are nanoseconds since the epoch. Frames of reference follow REP 103: `rig` has x forward, y left and z
up; `camera` is optical, with x right, y down and z forward.
"""

import json
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Literal, Self

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.calibration import Calibration, Mount
from drivers.errors import RecordingError
from drivers.frame import AmplitudeMode, Frame
from drivers.poses import camera_centre, camera_rotation
from drivers.rotations import quaternion
from drivers.text import json_of

CAMERA_DISTANCE = "camera/distance"
CAMERA_AMPLITUDE = "camera/amplitude"
CAMERA_FRAME = "camera/frame"
CAMERA_CALIBRATION = "camera/calibration"
STAGE_TRANSFORM = "stage/transform"

CAMERA_FRAME_ID = "camera"
RIG_FRAME_ID = "rig"

IMAGE_ENCODINGS: dict[str, tuple[np.dtype[Any], int]] = {
    "16UC1": (np.dtype("<u2"), 1),
    "mono16": (np.dtype("<u2"), 1),
    "32FC1": (np.dtype("<f4"), 1),
    "8UC1": (np.dtype("u1"), 1),
    "mono8": (np.dtype("u1"), 1),
    "rgb8": (np.dtype("u1"), 3),
}
"""Encodings of foxglove.RawImage used here: little-endian type and number of channels."""

RIG_FROM_STAGE = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Stage axes (x right, y down, z forward) to REP 103 (x forward, y left, z up)."""


@dataclass(frozen=True, slots=True)
class Schema:
    """How a payload is read: the schema's name, its language and its text or descriptor."""

    name: str
    encoding: Literal["protobuf", "jsonschema"]
    data: bytes


@dataclass(frozen=True, slots=True)
class Message:
    """One message, ready to be recorded and published.

    Attributes:
        topic: without leading slash.
        schema: how `payload` is read.
        payload: the serialised message.
        publish_time: ns since the epoch, sensor time mapped to the host.
        sequence: counted by the driver; a gap is a drop.
    """

    topic: str
    schema: Schema
    payload: bytes
    publish_time: int
    sequence: int = 0

    @property
    def message_encoding(self) -> Literal["protobuf", "json"]:
        return "protobuf" if self.schema.encoding == "protobuf" else "json"


class FrameFields(BaseModel):
    """Every field of a frame except its two images."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False, title="Frame")

    timestamp: int = Field(ge=0, lt=2**63, description="Middle of the exposure, ns since the epoch.")
    timestamp_uncertainty: int = Field(0, ge=0, lt=2**63, description="Half-width of its interval, ns.")
    sequence: int = Field(ge=0, lt=2**63, description="Counted by the driver; a gap is a drop.")
    burst: int | None = Field(None, ge=0, lt=2**63, description="The burst that the frame belongs to.")
    pose: int | None = Field(None, ge=0, lt=2**31, description="Index into the burst's plan of poses.")
    pan: float = Field(ge=-100, le=100, description="Stage angle, radians, positive to the left.")
    tilt: float = Field(ge=-100, le=100, description="Stage angle, radians, positive upwards.")
    integration_time: float | None = Field(
        gt=0, le=3600, description="Seconds per phase sample; null = not known."
    )
    modulation_frequency: float | None = Field(ge=1e3, le=1e12, description="Hz; null = none, or not known.")
    ambiguity_range: float | None = Field(
        ge=1e-3, le=1e6, description="Metres; distances do not wrap, or it is not known where, if null."
    )
    scale: float | None = Field(
        None, ge=1e-9, le=1e3, description="Metres per count of a 16UC1 distance; null = range / 65536."
    )
    has_amplitude: bool = Field(True, description="False = the camera gives none; no image of it comes.")
    amplitude_mode: AmplitudeMode = Field("linear", description="`gray` = multiplied by distance².")
    saturation_level: int = Field(
        0xFFF0, ge=0, lt=2**31, description="Amplitude from which a pixel is saturated, counts."
    )

    @classmethod
    def of(cls, frame: Frame) -> Self:
        return cls(**{name: getattr(frame, name) for name in cls.model_fields})

    def frame(
        self, counts: NDArray[np.uint16] | NDArray[np.float32], amplitude: NDArray[np.uint16] | None
    ) -> Frame:
        """The frame with these fields and images; raises `ValueError` where they do not fit each other."""
        return Frame(counts=counts, amplitude=amplitude, **self.model_dump(exclude={"has_amplitude"}))


def frame_messages(frame: Frame, mount: Mount) -> list[Message]:
    """Distance, amplitude where there is one, fields and stage transform of a frame."""
    at = frame.timestamp, frame.sequence
    encoding = "16UC1" if frame.counts.dtype == np.uint16 else "32FC1"
    images = [image_message(CAMERA_DISTANCE, frame.counts, encoding, CAMERA_FRAME_ID, *at)]
    if frame.amplitude is not None:
        images.append(image_message(CAMERA_AMPLITUDE, frame.amplitude, "mono16", CAMERA_FRAME_ID, *at))
    return [
        *images,
        json_message(CAMERA_FRAME, FrameFields.of(frame), *at),
        transform_message(STAGE_TRANSFORM, CAMERA_FRAME_ID, frame, mount),
    ]


def calibration_message(
    calibration: Calibration,
    timestamp: int,
    topic: str = CAMERA_CALIBRATION,
    sequence: int = 0,
    frame_id: str = CAMERA_FRAME_ID,
) -> Message:
    """foxglove.CameraCalibration; lens terms beyond `plumb_bob`'s five make it `rational_polynomial`."""
    lens = calibration.distortion
    size = next((size for size in (5, 8, 12, 14) if len(lens) <= size), len(lens))
    matrix = calibration.intrinsics.matrix
    message = CameraCalibration(
        timestamp=protobuf_time(timestamp),
        frame_id=frame_id,
        width=calibration.width,
        height=calibration.height,
        distortion_model="plumb_bob" if size == 5 else "rational_polynomial",
        D=[*lens, *[0.0] * (size - len(lens))],
        K=matrix.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.hstack([matrix, np.zeros((3, 1))]).ravel().tolist(),
    )
    return protobuf_message(topic, message, timestamp, sequence)


def image_message(
    topic: str,
    array: NDArray[Any],
    encoding: str,
    frame_id: str = CAMERA_FRAME_ID,
    timestamp: int = 0,
    sequence: int = 0,
) -> Message:
    """foxglove.RawImage of an array.

    Args:
        array: (H, W), or (H, W, 3) for `rgb8`, of the encoding's type.
        encoding: one of `IMAGE_ENCODINGS`.

    Raises:
        ValueError: the array's type or shape is not the encoding's.
    """
    dtype, channels = IMAGE_ENCODINGS[encoding]
    if array.dtype != dtype or array.shape[2:] != ((channels,) if channels > 1 else ()) or array.ndim < 2:
        raise ValueError(
            f"{encoding}: expected {dtype} with {channels} channel(s), got {array.dtype} {array.shape}"
        )
    message = RawImage(
        timestamp=protobuf_time(timestamp),
        frame_id=frame_id,
        width=array.shape[1],
        height=array.shape[0],
        encoding=encoding,
        step=array.shape[1] * channels * dtype.itemsize,
        data=array.astype(dtype, copy=False).tobytes(),
    )
    return protobuf_message(topic, message, timestamp, sequence)


def protobuf_message(topic: str, message: Protobuf, timestamp: int, sequence: int = 0) -> Message:
    """Any protobuf message with its schema."""
    schema = protobuf_schema(type(message))  # type: ignore[arg-type]  # a class is hashable, whatever its instances
    return Message(topic, schema, message.SerializeToString(), timestamp, sequence)


def json_message(topic: str, model: BaseModel, timestamp: int, sequence: int = 0) -> Message:
    """A pydantic model as JSON with its JSON schema."""
    return Message(topic, json_schema(type(model)), json_of(model), timestamp, sequence)


def protobuf_time(timestamp: int) -> Timestamp:
    """Nanoseconds since the epoch as protobuf has them."""
    stamp = Timestamp()
    stamp.FromNanoseconds(timestamp)
    return stamp


@cache
def protobuf_schema(kind: type[Protobuf]) -> Schema:
    """Schema of a protobuf message: its file descriptors with all that they import."""
    descriptors = build_file_descriptor_set(kind)
    return Schema(kind.DESCRIPTOR.full_name, "protobuf", descriptors.SerializeToString())


@cache
def json_schema(kind: type[BaseModel]) -> Schema:
    """JSON schema of a pydantic model, named `lidarboost.` and the model's title."""
    text = json.dumps(kind.model_json_schema(mode="serialization"))
    return Schema(
        f"lidarboost.{kind.model_config.get('title') or kind.__name__}", "jsonschema", text.encode()
    )


def decode_image(payload: bytes) -> NDArray[Any]:
    """The array in a foxglove.RawImage, (H, W) or (H, W, 3), read-only.

    Raises:
        RecordingError: not such a message, an encoding not known here, no pixel, or data of the wrong size.
    """
    image = RawImage()
    try:
        image.ParseFromString(payload)
    except DecodeError as error:
        raise RecordingError(f"not a foxglove.RawImage ({error})") from error
    if image.encoding not in IMAGE_ENCODINGS:
        known = ", ".join(IMAGE_ENCODINGS)
        raise RecordingError(f"image encoding {image.encoding!r} cannot be read here; known are {known}")
    dtype, channels = IMAGE_ENCODINGS[image.encoding]
    used = image.width * channels * dtype.itemsize
    if not (image.width and image.height):
        raise RecordingError(f"image of {image.height} × {image.width} pixels; expected at least one")
    if image.step < used or len(image.data) != image.step * image.height:
        raise RecordingError(
            f"image of {image.height} × {image.width} pixels ({image.encoding}, {image.step} bytes a row) "
            f"has {len(image.data)} bytes, expected {max(image.step, used) * image.height}"
        )
    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :used]
    pixels = np.ascontiguousarray(rows).view(dtype)
    pixels.flags.writeable = False
    return pixels if channels == 1 else pixels.reshape(image.height, image.width, channels)


def decode_calibration(payload: bytes) -> CameraCalibration:
    """A foxglove.CameraCalibration; raises `RecordingError` where it is not one."""
    message = CameraCalibration()
    try:
        message.ParseFromString(payload)
    except DecodeError as error:
        raise RecordingError(f"not a foxglove.CameraCalibration ({error})") from error
    return message


def transform_message(topic: str, child: str, frame: Frame, mount: Mount) -> Message:
    """foxglove.FrameTransform from `rig` to where the camera was while a frame was exposed.

    Args:
        topic: what it is published as.
        child: name of the camera's axes there.
        frame: by whose angles.
        mount: of the camera.
    """
    (x, y, z), (qx, qy, qz, qw) = _camera_in_rig(frame.pan, frame.tilt, mount)
    message = FrameTransform(
        timestamp=protobuf_time(frame.timestamp),
        parent_frame_id=RIG_FRAME_ID,
        child_frame_id=child,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
    return protobuf_message(topic, message, frame.timestamp, frame.sequence)


@lru_cache(maxsize=256)  # a plan comes back to its poses, and working one out costs as much as all else
def _camera_in_rig(pan: float, tilt: float, mount: Mount) -> tuple[list[float], list[float]]:
    turn = quaternion(RIG_FROM_STAGE @ camera_rotation(pan, tilt, mount))
    return (RIG_FROM_STAGE @ camera_centre(pan, tilt, mount)).tolist(), turn.tolist()
