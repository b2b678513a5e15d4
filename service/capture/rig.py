"""The camera on its stage: opened as configured, and opened again when one of them is lost."""

import logging
import time
from collections.abc import Callable

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.clock import Clock, SystemClock
from drivers.device import Device
from drivers.errors import DeviceLostError, DriverError, InitialisationError
from drivers.exposure import SAMPLES
from drivers.frame import Frame
from drivers.settings import CameraSettings
from drivers.stage import Stage
from service.capture.motion import HomePolicy, Motion, Operator

_FIRST_WAIT, _LONGEST_WAIT = 0.5, 2.0
"""Seconds before the first attempt to open a lost device again, and at most between later ones."""

_READOUT = 1.0
"""Seconds from an exposure's end to the frame, at most."""


_log = logging.getLogger(__name__)


class Rig:
    """A camera and a stage, one opened after the other, that come back after a fault.

    Args:
        camera, stage: closed devices.
        clock: of the devices.
        settings: put in force whenever the camera is opened, those that are named; None = as the camera has
            them.
        calibration: replaces the camera's own.
        home: when an unknown position of the stage may be found by homing.
        operator: who is told what is about to move, and asked whether it may.

    Attributes:
        motion: moves the stage.
        found: the camera's settings as it had them itself, once it was open.
        beats: counted up by whatever waits on purpose or tries again: a sign of life where no frame comes.
    """

    def __init__(
        self,
        camera: Camera,
        stage: Stage,
        clock: Clock | None = None,
        settings: CameraSettings | None = None,
        calibration: Calibration | None = None,
        home: HomePolicy = "ask",
        operator: Operator | None = None,
    ) -> None:
        self.camera, self.stage = camera, stage
        self.motion = Motion(stage, home, operator if operator is not None else Operator())
        self.clock = clock if clock is not None else SystemClock()
        self.settings = settings
        self._calibration = calibration
        self.found: CameraSettings | None = None
        self.reopened = 0
        self.beats = 0

    @property
    def replacement(self) -> Calibration | None:
        """What replaces the camera's own calibration, or None."""
        return self._calibration

    @property
    def calibration(self) -> Calibration:
        """The configured calibration, else the camera's."""
        return self._calibration or self.camera.calibration

    @property
    def is_open(self) -> bool:
        """Whether both are."""
        return self.camera.is_open and self.stage.is_open

    def exposed(self, frame: Frame) -> float:
        """When the exposure of a frame that has just come ended, `time.monotonic()`.

        Now, where its time is not of this clock, as in a replay, or the clock was set meanwhile.
        """
        end = frame.timestamp + round(SAMPLES / 2 * (frame.integration_time or 0.0) * 1e9)
        age = (self.clock.now() + self.clock.correction() - end) * 1e-9
        return time.monotonic() - (age if 0 < age < _READOUT else 0.0)

    def beat(self) -> None:
        """Count a sign of life."""
        self.beats += 1

    def open(self) -> None:
        """Open and start both; nothing moves. Closes both when raising.

        Raises:
            NotAvailableError, InitialisationError: as the devices; also settings the camera refuses.
        """
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release both, whatever state they are in."""
        for device in (self.camera, self.stage):
            self._close(device)

    def reopen(self, stopping: Callable[[], bool]) -> bool:
        """Stop the stage, close both and open them again, waiting longer after each failure.

        A stage that still knows where it is stays open: many forget it when they are opened.

        Returns:
            False where `stopping` became true first.

        Raises:
            MotionError: stopping the stage cost its position.
        """
        try:
            self.motion.halt()
        except DeviceLostError as error:
            _log.warning("stopping the stage: %s", error)
        self._close(self.camera)
        if self.stage.needs_home:
            self._close(self.stage)
        wait = _FIRST_WAIT
        while not stopping():
            self.beat()
            try:
                self._open()
            except DriverError as error:
                self._close(self.camera)
                _log.warning("opening again: %s; next attempt in %.1f s", error, wait)
            else:
                self.reopened += 1
                return True
            self.wait(wait, stopping)
            wait = min(2 * wait, _LONGEST_WAIT)
        return False

    def _open(self) -> None:
        self.stage.open()
        self.camera.mount_on(self.stage)
        self.camera.open()
        self.found = self.found or self.camera.settings
        if self.settings is not None:
            self.camera.settings = self.settings.over(self.camera.settings)
        self._check_shape()
        self.camera.start()

    @staticmethod
    def _close(device: Device) -> None:
        try:
            device.close()
        except DriverError as error:
            _log.warning("closing %s: %s", type(device).__name__, error)

    def apply(self, settings: CameraSettings) -> None:
        """Put settings in force, now and after every re-opening; raises as the camera, as it was then."""
        before = self.camera.settings
        try:
            self.camera.settings = settings
        except InitialisationError:
            self.camera.settings = before  # it may have taken some of them
            raise
        self.settings = self.camera.settings

    def wait(self, seconds: float, stopping: Callable[[], bool]) -> None:
        """Let time pass, until `stopping` becomes true."""
        end = self.clock.now() + round(seconds * 1e9)
        while not stopping() and self.clock.now() < end:
            self.beat()
            self.clock.sleep(min(0.1, (end - self.clock.now()) * 1e-9))

    def _check_shape(self) -> None:
        shape, expected = self.camera.capabilities.shape, self.calibration.shape
        if shape != expected:
            raise InitialisationError(
                f"frames have {shape[0]} × {shape[1]} pixels, their calibration is for {expected[0]} × "
                f"{expected[1]}: name the one that belongs to this camera in camera.calibration"
            )
