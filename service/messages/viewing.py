"""What is made of a map where somebody listens or a recording asks for it: points, and millimetres."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from numpy.typing import NDArray

from drivers.messages import Message, image_message, protobuf_message, protobuf_time
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.messages.topics import FUSED_DEPTH_MM, FUSED_FRAME_ID, FUSED_POINTS
from solver.geometry.lens import pixel_rays

POINT_FIELDS = ("x", "y", "z", "amplitude", "deviation")

_MOST_MILLIMETRES = 65_535


@dataclass(frozen=True, slots=True)
class Extras:
    """What a recording holds of each map beside the map itself.

    Attributes:
        points: every so many rows and columns of the map become points; 0 = no points.
        depth_mm: whether it holds the depth in millimetres.
    """

    points: int = 0
    depth_mm: bool = False

    def of(self, event: MapFused) -> tuple[Message, ...]:
        """The messages, made once for all who ask for the same."""
        return event.once(self, lambda: self.messages(event.map))

    def messages(self, result: FusedMap) -> tuple[Message, ...]:
        """The messages of a map."""
        points = (points_message(result, self.points),) if self.points else ()
        return (*points, depth_mm_message(result)) if self.depth_mm else points


ON_DEMAND: dict[str, Callable[[MapFused], Message]] = {
    FUSED_POINTS: lambda event: event.once(FUSED_POINTS, lambda: points_message(event.map)),
    FUSED_DEPTH_MM: lambda event: event.once(FUSED_DEPTH_MM, lambda: depth_mm_message(event.map)),
}
"""Topics that are made while somebody listens, or when they are asked for."""


def points_message(result: FusedMap, every: int = 1) -> Message:
    """foxglove.PointCloud of known pixels: x, y, z in `fused`, amplitude and deviation, float32.

    The deviation is the distance's, along the ray; an amplitude that the method does not give is NaN.

    Args:
        result: the map.
        every: so many rows and columns are one point.
    """
    values = fused_points(result, every)
    cloud = PointCloud(
        timestamp=protobuf_time(result.frame.timestamp),
        frame_id=FUSED_FRAME_ID,
        point_stride=values.itemsize * len(POINT_FIELDS),
        fields=[
            PackedElementField(name=name, offset=values.itemsize * place, type=PackedElementField.FLOAT32)
            for place, name in enumerate(POINT_FIELDS)
        ],
        data=values.astype("<f4", copy=False).tobytes(),
    )
    cloud.pose.orientation.w = 1.0
    return protobuf_message(FUSED_POINTS, cloud, result.frame.timestamp, result.frame.sequence)


def fused_points(result: FusedMap, every: int = 1) -> NDArray[np.float32]:
    """(P, 5) float32: x, y, z in metres, amplitude and deviation of each known pixel, or each `every`-th."""
    first = every // 2
    picked = np.s_[first::every, first::every]
    K = result.intrinsics.copy()
    K[:2, 2] = (K[:2, 2] - first) / every
    K[0, 0] /= every
    K[1, 1] /= every
    depth = result.depth[picked]
    finite = np.isfinite(depth).ravel()
    # Picking out all of them would take longer than all else.
    known = slice(None) if finite.all() else np.flatnonzero(finite)
    rays = pixel_rays(depth.shape, K, result.calibration.distortion or None).reshape(-1, 2)[known]
    points = np.empty((len(rays), len(POINT_FIELDS)), dtype=np.float32)
    points[:, 2] = depth.ravel()[known]
    points[:, :2] = rays * points[:, 2:3]
    points[:, 3] = np.nan if result.amplitude is None else result.amplitude[picked].ravel()[known]
    points[:, 4] = result.deviation[picked].ravel()[known]
    return points


def depth_mm_message(result: FusedMap) -> Message:
    """foxglove.RawImage 16UC1 of the depth in millimetres, 0 = unknown or beyond 65.535 m.

    Viewers read K of a calibration and not its distortion, so the distortion is taken out: pixel by pixel the
    nearest one of the map, for depths must not be mixed.
    """
    metres: NDArray[np.floating] = result.depth
    if result.calibration.distortion:
        rows, columns = _undistorted(
            (metres.shape[0], metres.shape[1]),
            tuple(result.intrinsics.ravel().tolist()),
            result.calibration.distortion,
        )
        metres = np.asarray(
            cv2.remap(
                metres, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
            ),
            np.float32,
        )
    scaled = np.nan_to_num(metres, nan=0.0, posinf=0.0, neginf=0.0) * np.float32(1000) + np.float32(0.5)
    scaled[(scaled < 0) | (scaled >= _MOST_MILLIMETRES + 1)] = 0
    millimetres = scaled.astype(np.uint16)
    at = result.frame.timestamp, result.frame.sequence
    return image_message(FUSED_DEPTH_MM, millimetres, "16UC1", FUSED_FRAME_ID, *at)


@lru_cache(maxsize=4)  # a session has one camera
def _undistorted(
    shape: tuple[int, int], intrinsics: tuple[float, ...], lens: tuple[float, ...]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rows and columns at which a camera with this lens sees what one without sees at each pixel."""
    K = np.reshape(intrinsics, (3, 3))
    columns, rows = cv2.initUndistortRectifyMap(
        K, np.asarray(lens), None, K, (shape[1], shape[0]), cv2.CV_32FC1
    )
    return np.asarray(rows, np.float32), np.asarray(columns, np.float32)
