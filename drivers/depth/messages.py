"""Messages of ROS and Foxglove about a depth camera: images, optics, transforms."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from drivers.depth.compressed import decompressed, is_depth_format, is_lossy
from drivers.depth.optics import Lens, foxglove_lens, ros_lens
from drivers.depth.pixels import DEPTH_ENCODINGS, unpacked
from drivers.depth.typestore import ros_message
from drivers.errors import RecordingError

Form = Literal["cdr", "ros1", "protobuf"]

IMAGE_TYPES = frozenset(
    {
        "sensor_msgs/msg/Image",
        "sensor_msgs/msg/CompressedImage",
        "foxglove.RawImage",
        "foxglove.CompressedImage",
    }
)
LENS_TYPES = frozenset({"sensor_msgs/msg/CameraInfo", "foxglove.CameraCalibration"})
TRANSFORM_TYPES = frozenset(
    {"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage", "foxglove.FrameTransform", "foxglove.FrameTransforms"}
)


@dataclass(frozen=True, slots=True)
class DepthImage:
    """An image as a message brings it.

    Attributes:
        stamp: ns since the epoch, or of another clock; 0 = not said.
        frame_id: whose axes it has; may be empty.
        told: encoding, or format of a compressed one.
        may_be_depth: whether an image of that encoding usually holds depth.
        is_lossy: whether its compression changed the values, so that no depth survived.
        decode: gives the pixels; raises `RecordingError`.
    """

    stamp: int
    frame_id: str
    told: str
    may_be_depth: bool
    is_lossy: bool
    decode: Callable[[], NDArray[Any]] = field(repr=False)

    def depth(self) -> NDArray[Any]:
        """The pixels of an image that is to hold depth; raises `RecordingError`."""
        if self.is_lossy:
            raise RecordingError(f"compression {self.told!r} changes values, so that no depth survives it")
        return self.decode()


class LensFound(NamedTuple):
    """Optics as a message brings them, for the image as it is and for the rectified one."""

    frame_id: str
    raw: Lens
    rectified: Lens


class Link(NamedTuple):
    """A transform from `parent` to `child`: translation (metres) and quaternion (x, y, z, w)."""

    parent: str
    child: str
    stamp: int
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


def image_of(kind: str, form: Form, payload: bytes) -> DepthImage:
    """An image of one of `IMAGE_TYPES`; raises `RecordingError` where the bytes are none."""
    message = _message(kind, form, payload)
    if form == "protobuf":
        stamp, frame_id = message.timestamp.ToNanoseconds(), message.frame_id
    else:
        stamp, frame_id = _nanoseconds(message.header.stamp), message.header.frame_id
    if kind.endswith("CompressedImage"):
        return _compressed(stamp, frame_id, message.format, message.data)
    is_bigendian = form != "protobuf" and bool(message.is_bigendian)
    shape, step = (message.height, message.width), message.step
    return DepthImage(
        stamp,
        frame_id,
        message.encoding,
        message.encoding in DEPTH_ENCODINGS,
        False,
        lambda: unpacked(message.encoding, shape, step, is_bigendian, message.data),
    )


def lens_of(kind: str, form: Form, payload: bytes) -> LensFound:
    """Optics of one of `LENS_TYPES`; raises `RecordingError` where the bytes are none."""
    message = _message(kind, form, payload)
    if form == "protobuf":
        return LensFound(message.frame_id, foxglove_lens(message, False), foxglove_lens(message, True))
    return LensFound(message.header.frame_id, ros_lens(message, False), ros_lens(message, True))


def links_of(kind: str, form: Form, payload: bytes) -> list[Link]:
    """Transforms of one of `TRANSFORM_TYPES`; raises `RecordingError` where the bytes are none."""
    message = _message(kind, form, payload)
    if kind == "foxglove.FrameTransform":
        return [_foxglove_link(message)]
    if form == "protobuf":
        return [_foxglove_link(transform) for transform in message.transforms]
    return [_ros_link(transform) for transform in message.transforms]


def _compressed(stamp: int, frame_id: str, told: str, data: Any) -> DepthImage:
    lossy = is_lossy(told)
    may_be_depth = is_depth_format(told) or (not lossy and told.upper().startswith(("16UC1", "32FC1")))
    return DepthImage(stamp, frame_id, told, may_be_depth, lossy, lambda: decompressed(told, data))


def _message(kind: str, form: Form, payload: bytes) -> Any:
    if form != "protobuf":
        return ros_message(kind, form, payload)
    found = _foxglove_types()[kind]()
    try:
        found.ParseFromString(payload)
    except DecodeError as error:
        raise RecordingError(f"not a {kind} ({error})") from error
    return found


def _foxglove_types() -> dict[str, Any]:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

    kinds = (CameraCalibration, CompressedImage, FrameTransform, FrameTransforms, RawImage)
    return {kind.DESCRIPTOR.full_name: kind for kind in kinds}


def _ros_link(transform: Any) -> Link:
    place, turn = transform.transform.translation, transform.transform.rotation
    return Link(
        transform.header.frame_id.lstrip("/"),
        transform.child_frame_id.lstrip("/"),
        _nanoseconds(transform.header.stamp),
        (place.x, place.y, place.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def _foxglove_link(transform: Any) -> Link:
    place, turn = transform.translation, transform.rotation
    return Link(
        transform.parent_frame_id,
        transform.child_frame_id,
        transform.timestamp.ToNanoseconds(),
        (place.x, place.y, place.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(np.uint32(stamp.nanosec))
