"""The first real camera found, else a recording."""

import logging
from pathlib import Path
from typing import Any

from pydantic import Field

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import DriverError, NotAvailableError
from drivers.frame import Frame
from drivers.recording import Recording
from drivers.settings import CameraSettings, Capabilities
from drivers.stage import Stage

log = logging.getLogger(__name__)


class AutoOptions(BackendOptions):
    """What to look for, and what to play where nothing is found; each entry goes to the backend it fits."""

    recording: Path | None = Field(None, description="Recording to play where no real camera is found.")
    serial: str | None = Field(None, description="Serial number; none = the first camera found.")
    model: str | None = Field(
        None, description="SR2A, SR2B, SR3000, SR4000 or SR4500; none = told by the camera."
    )
    library: Path | None = Field(None, description="Absolute path of the vendor's library.")
    address: str | None = Field(None, description="IP address of a camera on Ethernet.")
    profile: Path | None = Field(None, description="USB profile file, for example one learned from a trace.")
    allow_inferred: bool = Field(False, description="Use USB profile entries that are not documented.")


class AutoCamera(Camera):
    """Stands for the camera that it found, in every respect.

    A real camera that is there but cannot be used is an error, never a reason to play the recording; and
    once a real one was open, only a real one is opened again.
    """

    Options = AutoOptions
    options: AutoOptions

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._inner: Camera | None = None
        self._was_real = False

    def mount_on(self, stage: Stage) -> None:
        super().mount_on(stage)
        if self._inner is not None:
            self._inner.mount_on(stage)

    def _open(self) -> None:
        if self._inner is not None and self._was_real:
            self._inner.open()
        else:
            self._inner = self._open_real() or self._open_recording()
        if self._stage is not None:
            self._inner.mount_on(self._stage)
        self._was_real = self._inner.capabilities.source == "device"
        self._settings = self._inner.settings

    def _open_real(self) -> Camera | None:
        from drivers.backends import make_camera

        names = self._present()
        reasons = []
        for name in names:
            try:
                camera = make_camera(name, self._options_of(name), self.clock)
                camera.open()
            except DriverError as error:
                reasons.append(f"{name}: {error}")
            else:
                log.info("camera: %s through %s", camera.capabilities.model, name)
                return camera
        if reasons:
            raise NotAvailableError(f"a camera is there, but cannot be used. {'; '.join(reasons)}")
        return None

    def _present(self) -> list[str]:
        """Backends to try: none where no camera is plugged in and none is named."""
        from drivers.mesasr.library import find_library
        from drivers.usb.discovery import find_cameras
        from drivers.usb.profile import Profile

        profile = self.options.profile
        try:
            is_on_usb = bool(find_cameras(Profile.load(profile) if profile is not None else None))
        except NotAvailableError as error:
            log.warning("USB cannot be searched for cameras: %s", error)
            is_on_usb = False
        if not is_on_usb and self.options.address is None:
            return []
        try:
            find_library(self.options.library)
        except NotAvailableError as error:
            log.debug("%s", error)
            return ["usb"]
        return ["mesasr", "usb"]

    def _options_of(self, name: str) -> dict[str, Any]:
        from drivers.backends import camera_class

        fields = camera_class(name).Options.model_fields
        return {key: value for key, value in self.options if key in fields and value is not None}

    def _open_recording(self) -> Camera:
        from drivers.backends import make_camera

        if self.options.recording is None:
            raise NotAvailableError(
                "no SwissRanger found on USB, and no recording is named: plug a camera in (see `lidarboost "
                "devices`), name a recording to play, or use the camera `simulated`"
            )
        log.warning("no camera found: playing the recording %s", self.options.recording)
        # Paced, as the camera that it stands for would be.
        camera = make_camera("replay", {"path": self.options.recording, "speed": 1.0}, self.clock)
        camera.open()
        return camera

    def _close(self) -> None:
        if self._inner is not None:
            self._inner.close()

    def _start(self) -> None:
        self._found.start()

    def _stop(self) -> None:
        self._found.stop()

    def _grab(self, timeout: float) -> Frame:
        return self._found.grab(timeout)

    def _apply(self, settings: CameraSettings) -> CameraSettings:
        self._found.settings = settings
        return self._found.settings

    def _calibration(self) -> Calibration:
        return self._found.calibration

    def _capabilities(self) -> Capabilities:
        return self._found.capabilities

    def _longest_exposure(self, integration_time: float | None) -> float:
        return self._found._longest_exposure(integration_time)

    @property
    def recording(self) -> Recording | None:
        """The recording that is played for want of a camera, or None."""
        played = getattr(self._found, "recording", None)
        return played if isinstance(played, Recording) else None

    @property
    def _found(self) -> Camera:
        assert self._inner is not None
        return self._inner
