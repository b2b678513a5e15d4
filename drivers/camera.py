"""The base of every camera backend."""

from abc import abstractmethod

from drivers.calibration import Calibration
from drivers.clock import Clock
from drivers.device import BackendOptions, Device
from drivers.errors import StateError
from drivers.exposure import SAMPLES
from drivers.frame import Frame
from drivers.settings import LONGEST_INTEGRATION_TIME, CameraSettings, Capabilities
from drivers.stage import Stage


class Camera(Device):
    """A camera: closed, then open, then started; frames come while it is started.

    A backend names its `Options` and fills the hooks (`_open`, `_close`, `_start`, `_stop`, `_grab`,
    `_apply`, `_calibration`, `_capabilities`, and `_longest_exposure` where it knows better); state, order
    of calls and settings are handled here.
    """

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._is_started = False
        self._settings = CameraSettings()
        self._stage: Stage | None = None

    @property
    def is_started(self) -> bool:
        return self._is_started

    def close(self) -> None:
        """Stop and release the camera; safe for one that is already closed, or gone."""
        try:
            self.stop()
        finally:
            super().close()

    def start(self) -> None:
        """Begin to acquire. Starting a started camera does nothing."""
        self._require_open("start")
        if not self._is_started:
            self._start()
            self._is_started = True

    def stop(self) -> None:
        """Cease to acquire. Stopping a stopped camera does nothing."""
        if self._is_started:
            self._is_started = False
            self._stop()

    def grab(self, timeout: float = 2.0) -> Frame:
        """The next frame, waiting at most `timeout` seconds, and besides as long as it takes to throw away
        what a failed frame or other settings have left behind.

        Raises:
            StateError: the camera is not started.
            DeviceTimeoutError: no frame in time.
            EndOfRecordingError: a recording has been played to its end.
            DeviceLostError: the device is gone; close and open it again.
            OperationError: a frame was lost or garbled; the next call may succeed.
        """
        if not self._is_started:
            raise StateError(f"cannot grab from a {type(self).__name__} that is not started: start it first")
        frame = self._grab(timeout)
        if not isinstance(frame, Frame):
            raise TypeError(f"{type(self).__name__}._grab gave {frame!r}; expected a Frame")
        return frame

    def exposure_start(self, frame: Frame) -> int:
        """The earliest time at which this camera may have begun to expose a frame, ns since the epoch."""
        half = self._longest_exposure(frame.integration_time) / 2
        return frame.timestamp - frame.timestamp_uncertainty - round(half * 1e9)

    @property
    def settings(self) -> CameraSettings:
        """The settings in force. Setting them applies from the next frame on.

        Raises:
            StateError: set while the camera is closed.
            InitialisationError: the camera cannot take a value, for example an impossible frame rate.
        """
        return self._settings

    @settings.setter
    def settings(self, settings: CameraSettings) -> None:
        self._require_open("set")
        self._settings = self._apply(settings)

    @property
    def calibration(self) -> Calibration:
        """The calibration known to the camera; nominal optics where nothing better is."""
        self._require_open("read the calibration of")
        return self._calibration()

    @property
    def capabilities(self) -> Capabilities:
        """What the camera is; known once it is open."""
        self._require_open("read the capabilities of")
        return self._capabilities()

    @property
    def temperature(self) -> float | None:
        """°C, as the camera told last; None where it tells none. It asks nothing of the device."""
        return None

    def mount_on(self, stage: Stage) -> None:
        """Say which stage turns this camera; a simulated camera sees the world turn with it."""
        self._stage = stage

    @abstractmethod
    def _start(self) -> None: ...

    @abstractmethod
    def _stop(self) -> None: ...

    @abstractmethod
    def _grab(self, timeout: float) -> Frame: ...

    @abstractmethod
    def _apply(self, settings: CameraSettings) -> CameraSettings:
        """Put settings in force and return what the device really took."""

    @abstractmethod
    def _calibration(self) -> Calibration: ...

    @abstractmethod
    def _capabilities(self) -> Capabilities: ...

    def _longest_exposure(self, integration_time: float | None) -> float:
        """Seconds that the exposure of a frame takes at most, from the first sample to the last.

        Args:
            integration_time: seconds per sample, None = unknown.
        """
        return SAMPLES * (integration_time if integration_time is not None else LONGEST_INTEGRATION_TIME)
