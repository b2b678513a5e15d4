"""Calibrations of other cameras: sensor_msgs/CameraInfo and foxglove.CameraCalibration."""

from dataclasses import dataclass
from typing import Any

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.lens_message import calibration_of


@dataclass(frozen=True, slots=True)
class Lens:
    """The fields that both messages have, for the image as it is sent."""

    width: int
    height: int
    distortion_model: str
    K: tuple[float, ...]
    D: tuple[float, ...]

    def calibration(self, origin: str) -> Calibration:
        """As it is used here.

        Raises:
            RecordingError: not calibrated, or a lens model that cannot be used, by its name.
        """
        found = calibration_of(self, origin)
        if found is None:
            raise RecordingError(
                f"{origin}: says that the camera is not calibrated (K is zero); calibrate it, or name a "
                "calibration file (--calibration)"
            )
        return found.model_copy(update={"source": origin})


def ros_lens(info: Any, rectified: bool) -> Lens:
    """Of a sensor_msgs/CameraInfo (ROS 2 names its fields k, d, p; ROS 1 K, D, P).

    K and P are of the full resolution; binning and region of interest make the image of it
    (image_geometry, PinholeCameraModel).

    Args:
        info: the message.
        rectified: whether the image is rectified: P holds then, and no distortion is left.
    """
    K, P, D = (tuple(map(float, _field(info, name))) for name in "kpd")
    if rectified and any(P):
        K, D = (P[0], P[1], P[2], P[4], P[5], P[6], P[8], P[9], P[10]), ()
    roi = info.roi
    across, down = max(1, info.binning_x), max(1, info.binning_y)
    width, height = roi.width or info.width, roi.height or info.height
    if any(K) and len(K) == 9:
        cx, cy = (K[2] - roi.x_offset) / across, (K[5] - roi.y_offset) / down
        K = (K[0] / across, K[1], cx, K[3], K[4] / down, cy, *K[6:])
    return Lens(width // across, height // down, info.distortion_model, K, D)


def foxglove_lens(message: Any, rectified: bool) -> Lens:
    """Of a foxglove.CameraCalibration; `rectified` as for `ros_lens`."""
    K, D, P = tuple(message.K), tuple(message.D), tuple(message.P)
    if rectified and len(P) == 12 and any(P):
        K, D = (P[0], P[1], P[2], P[4], P[5], P[6], P[8], P[9], P[10]), ()
    return Lens(message.width, message.height, message.distortion_model, K, D)


def _field(info: Any, name: str) -> Any:
    return getattr(info, name) if hasattr(info, name) else getattr(info, name.upper())
