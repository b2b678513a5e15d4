"""Cameras and rotation stages, the frames they produce, and recordings of them."""

from drivers.backends import backend_names, make_camera, make_stage
from drivers.calibration import Calibration, sr3000_calibration, sr4000_calibration
from drivers.camera import Camera
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    DriverError,
    EndOfRecordingError,
    InitialisationError,
    LimitError,
    MotionStoppedError,
    NotAvailableError,
    OperationError,
    RecordingError,
    StateError,
    StorageError,
)
from drivers.frame import Frame
from drivers.position import Limits, Position
from drivers.settings import CameraSettings, Capabilities
from drivers.stage import Stage

__all__ = [
    "Calibration",
    "Camera",
    "CameraSettings",
    "Capabilities",
    "DeviceLostError",
    "DeviceTimeoutError",
    "DriverError",
    "EndOfRecordingError",
    "Frame",
    "InitialisationError",
    "LimitError",
    "Limits",
    "MotionStoppedError",
    "NotAvailableError",
    "OperationError",
    "Position",
    "RecordingError",
    "Stage",
    "StateError",
    "StorageError",
    "backend_names",
    "make_camera",
    "make_stage",
    "sr3000_calibration",
    "sr4000_calibration",
]
