"""A SwissRanger through libMesaSR."""

import ctypes
import logging
import re
from ctypes import c_void_p
from pathlib import Path
from threading import RLock

from pydantic import Field

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import (
    DeviceLostError,
    InitialisationError,
    NotAvailableError,
    OperationError,
)
from drivers.exposure import mid_exposure
from drivers.frame import Frame
from drivers.mesasr.adjust import Adjuster
from drivers.mesasr.coordinates import fit_lens, pixel_rays
from drivers.mesasr.images import AMPLITUDE, DISTANCE, copy_image, image_addresses
from drivers.mesasr.library import find_library, load_library
from drivers.mesasr.models import Mode, model_of
from drivers.pacing import Pacer
from drivers.settings import CameraSettings, Capabilities

log = logging.getLogger(__name__)

MAX_FAILURES = 5
"""Failed frames in a row after which the camera counts as lost, so that it is opened afresh."""

NO_SERIAL = 0xFFFFFFFF

DEVICE_STRING_BYTES = 512


class MesaOptions(BackendOptions):
    """Which camera to open, and how it should acquire."""

    library: Path | None = Field(None, description="Absolute path of libMesaSR; none = the system's folders.")
    serial: str | None = Field(
        None, pattern=r"^[0-9A-Fa-f]{1,8}$", description="Last eight hexadecimal digits of the label."
    )
    address: str | None = Field(None, description="IP address of a camera on Ethernet; none = USB.")
    model: str | None = Field(None, description="SR2A, SR2B, SR3000 or SR4000; none = told by the camera.")
    acquire_mode: int | None = Field(
        None, ge=0, le=0xFFFF, description="Acquire mode bits; none = filters off, software trigger if any."
    )
    auto_exposure: bool = Field(False, description="Let the vendor's library choose the integration time.")
    saturation_level: int = Field(
        0x8000, ge=1, le=0xFFFF, description="Amplitude from which a pixel counts as saturated, counts."
    )


class MesaCamera(Camera):
    """Takes frames through the vendor's library, one call at a time.

    Settings outlive `close`: when the camera is opened again they are applied again.
    """

    Options = MesaOptions
    options: MesaOptions

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._lock = RLock()
        self._pacer = Pacer(self.clock)
        self._handle = c_void_p()
        self._wanted: CameraSettings | None = None
        self._known_calibration: Calibration | None = None
        self._sequence = 0
        self._failures = 0

    def _open(self) -> None:
        self._library = load_library(find_library(self.options.library))
        with self._lock:
            self._connect()
            try:
                self._set_up()
            except BaseException as error:
                self._close()
                if isinstance(error, OperationError):
                    raise InitialisationError(f"the camera could not be set up: {error}") from error
                raise

    def _connect(self) -> None:
        self._handle = c_void_p()
        if self.options.address is not None:
            if not self._library.has("SR_OpenETH"):
                raise NotAvailableError(f"{self._library.path} cannot open cameras on Ethernet")
            target = f"at {self.options.address}"
            address = self.options.address.encode()
            opened = self._library.call("SR_OpenETH", ctypes.byref(self._handle), address)
        else:
            serial = int(self.options.serial or "0", 16)
            target = f"with serial {self.options.serial}" if serial else "on USB"
            opened = self._library.call("SR_OpenUSB", ctypes.byref(self._handle), serial)
        if opened <= 0 or not self._handle.value:
            self._handle = c_void_p()
            raise NotAvailableError(
                f"libMesaSR found no camera {target}, or may not open it (result {opened})"
                f"{self._library.explain()}; look at `lidarboost devices` for ids and permissions"
            )

    def _set_up(self) -> None:
        call, handle = self._library.call, self._handle
        self._shape = (call("SR_GetRows", handle), call("SR_GetCols", handle))
        self._model = model_of(self._product(), self.options.model)
        self._serial = self._read_serial()
        self._mode = Mode(self.options.acquire_mode) if self.options.acquire_mode else self._model.mode
        self._adjuster = Adjuster(self._library, handle, self._model, self._mode)
        self._adjuster.auto_exposure(self.options.auto_exposure)
        in_force = self._adjuster.read()
        self._settings = self._apply(self._wanted if self._wanted is not None else in_force)
        self._wanted = self._settings if self._wanted is None else self._wanted

    def _close(self) -> None:
        with self._lock:
            handle, self._handle = self._handle, c_void_p()
            if handle.value:
                status = self._library.call("SR_Close", handle)
                if status < 0:
                    log.warning("SR_Close: %s", _CLOSE_ERRORS.get(status, f"failed with {status}"))

    def _start(self) -> None:
        self._failures = 0
        self._pacer.start()

    def _stop(self) -> None:
        pass

    def _grab(self, timeout: float) -> Frame:
        deadline = self.clock.now() + round(timeout * 1e9)
        self._pacer.wait(self._settings.frame_rate, deadline)
        self._sequence += 1
        with self._lock:
            remaining = (deadline - self.clock.now()) / 1e9
            if self._library.has("SR_SetTimeout"):
                self._library.call("SR_SetTimeout", self._handle, max(1, round(remaining * 1e3)))
            requested = self.clock.now()
            received = self._library.call("SR_Acquire", self._handle)
            finished = self.clock.now()
            if received <= 0:
                raise self._failure(received)
            self._failures = 0
            return self._frame(requested, finished)

    def _frame(self, requested: int, finished: int) -> Frame:
        if self._moves != self._library.moves:
            self._find_images()
        settings = self._settings
        integration_time = settings.integration_time
        if self.options.auto_exposure:
            integration_time = self._adjuster.read_integration_time()
        rows, columns = self._shape
        timestamp, uncertainty = mid_exposure(
            requested,
            finished,
            *self._model.profile.exposure_bounds(integration_time),
            frame_bytes=rows * columns * 4,
            waits=bool(self._mode & Mode.SOFTWARE_TRIGGER),
        )
        return Frame(
            counts=copy_image(self._images[DISTANCE], self._shape),
            amplitude=copy_image(self._images[AMPLITUDE], self._shape),
            timestamp=timestamp,
            timestamp_uncertainty=uncertainty,
            sequence=self._sequence,
            pan=0.0,
            tilt=0.0,
            integration_time=integration_time,
            modulation_frequency=settings.modulation_frequency,
            ambiguity_range=settings.ambiguity_range,
            amplitude_mode=settings.amplitude_mode,
            saturation_level=self.options.saturation_level,
        )

    def _failure(self, received: int) -> OperationError:
        self._failures += 1
        text = f"SR_Acquire failed with {received}{self._library.explain()}"
        if self._failures >= MAX_FAILURES:
            return DeviceLostError(f"{text}, {self._failures} times in a row: the camera counts as lost")
        return OperationError(text)

    def _apply(self, settings: CameraSettings) -> CameraSettings:
        with self._lock:
            taken = self._adjuster.apply(settings)
            self._find_images()
        self._wanted = settings
        return taken

    def _find_images(self) -> None:
        """A change of mode can move the images: their addresses are asked for anew."""
        self._moves = self._library.moves
        self._images = image_addresses(self._library, self._handle, self._shape)

    def _calibration(self) -> Calibration:
        if self._known_calibration is None:
            self._known_calibration = self._measured_lens()
        return self._known_calibration

    def _measured_lens(self) -> Calibration:
        profile = self._model.profile
        nominal = profile.nominal_calibration() if profile.calibration.value is not None else None
        if self._library.has("SR_CoordTrfPntFlt"):
            try:
                with self._lock:
                    rays = pixel_rays(self._library, self._handle, self._shape)
                return fit_lens(rays, nominal, "rays of the vendor's library")
            except OperationError as error:
                log.warning("%s; the nominal optics are used", error)
        return profile.nominal_calibration()

    def _capabilities(self) -> Capabilities:
        return Capabilities(
            shape=self._shape,
            source="device",
            carries_pose=False,
            model=self._model.name,
            serial=self._serial,
        )

    def _product(self) -> int | None:
        if not self._library.has("SR_GetDeviceString"):
            return None
        text = ctypes.create_string_buffer(DEVICE_STRING_BYTES)
        if self._library.call("SR_GetDeviceString", self._handle, text, DEVICE_STRING_BYTES) <= 0:
            return None
        match = re.search(rb"ProductID:0x([0-9a-fA-F]+)", text.value)
        return int(match[1], 16) if match else None

    def _read_serial(self) -> str | None:
        if not self._library.has("SR_ReadSerial"):
            return None
        serial = self._library.call("SR_ReadSerial", self._handle)
        return None if serial == NO_SERIAL else f"{serial:08X}"


_CLOSE_ERRORS = {
    -1: "wrong device",
    -2: "the interface could not be released",
    -3: "the device could not be closed",
}
"""Results of SR_Close (vendor header)."""
