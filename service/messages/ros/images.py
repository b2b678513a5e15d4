"""Images and their optics: sensor_msgs/Image and CameraInfo."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from service.messages.ros.topics import CAMERA_INFO, IMAGE
from service.messages.ros.types import RosMessage, RosTypes, stamped

ENCODINGS = {"float32": "32FC1", "uint16": "mono16"}
"""By type of the array; REP 118: 32FC1 depth is in metres, NaN = unknown."""


def image(types: RosTypes, topic: str, array: NDArray[Any], timestamp: int, frame_id: str) -> RosMessage:
    """An image of one channel.

    Args:
        array: (H, W) float32 or uint16.
        timestamp: ns since the epoch.
        frame_id: optical axes.
    """
    kind = array.dtype.newbyteorder("<")
    pixels = np.ascontiguousarray(array.astype(kind, copy=False))
    message = types.make(
        IMAGE,
        header=types.header(timestamp, frame_id),
        height=array.shape[0],
        width=array.shape[1],
        encoding=ENCODINGS[array.dtype.name],
        is_bigendian=0,
        step=array.shape[1] * array.itemsize,
        data=pixels.view(np.uint8).ravel(),
    )
    return RosMessage(topic, types.cdr(IMAGE, message))


class CameraInfos:
    """Optics beside images: what a calibration says is encoded once, and only the stamp is new each time."""

    def __init__(self, types: RosTypes) -> None:
        self._types = types
        self._encoded: dict[str, tuple[Calibration, bytearray]] = {}

    def __call__(self, topic: str, calibration: Calibration, timestamp: int, frame_id: str) -> RosMessage:
        """As `camera_info`; a topic has one frame of reference."""
        known, payload = self._encoded.get(topic, (None, bytearray()))
        if known != calibration:
            payload = camera_info(self._types, topic, calibration, timestamp, frame_id).payload
            self._encoded[topic] = calibration, payload
        return RosMessage(topic, stamped(payload, timestamp))


def camera_info(
    types: RosTypes, topic: str, calibration: Calibration, timestamp: int, frame_id: str
) -> RosMessage:
    """Optics of an image as the lens shows it, or of a rectified one, whose calibration has no distortion."""
    K, lens = calibration.intrinsics.matrix, calibration.distortion
    terms = np.zeros(5 if len(lens) <= 5 else 8 if len(lens) <= 8 else len(lens))
    terms[: len(lens)] = lens
    roi = types.make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    message = types.make(
        CAMERA_INFO,
        header=types.header(timestamp, frame_id),
        height=calibration.height,
        width=calibration.width,
        distortion_model="plumb_bob" if len(terms) == 5 else "rational_polynomial",
        d=terms,
        k=K.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([K, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )
    return RosMessage(topic, types.cdr(CAMERA_INFO, message))
