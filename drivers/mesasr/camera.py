"""A SwissRanger through libMesaSR."""

import logging
from ctypes import c_void_p
from pathlib import Path
from threading import RLock

from pydantic import Field

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import DeviceTimeoutError, InitialisationError, OperationError
from drivers.exposure import SAMPLES, mid_exposure
from drivers.frame import Frame
from drivers.mesasr.acquire import Acquirer
from drivers.mesasr.adjust import Adjuster
from drivers.mesasr.connection import connect, disconnect, product_of, serial_of
from drivers.mesasr.coordinates import fit_lens, pixel_rays
from drivers.mesasr.images import AMPLITUDE, CONFIDENCE, DISTANCE, copy_image, image_addresses
from drivers.mesasr.library import find_library, load_library
from drivers.mesasr.models import Mode, model_of
from drivers.pacing import Pacer
from drivers.settings import CameraSettings, Capabilities

log = logging.getLogger(__name__)


class MesaOptions(BackendOptions):
    """Which camera to open, and how it should acquire."""

    library: Path | None = Field(None, description="Absolute path of libMesaSR; none = the system's folders.")
    serial: str | None = Field(
        None, pattern=r"^[0-9A-Fa-f]{1,8}$", description="Last eight hexadecimal digits of the label."
    )
    address: str | None = Field(None, description="IP address of a camera on Ethernet; none = USB.")
    model: str | None = Field(
        None, description="SR2A, SR2B, SR3000, SR4000 or SR4500; none = told by the camera."
    )
    acquire_mode: int | None = Field(
        None, ge=0, le=0xFFFF, description="Acquire mode bits; none = filters off, software trigger if any."
    )
    auto_exposure: bool = Field(False, description="Let the vendor's library choose the integration time.")
    dual_integration: int | None = Field(
        None, ge=0, le=100, description="Second exposure, % of the integration time; none = as it is."
    )
    saturation_threshold: int | None = Field(
        None,
        ge=0,
        le=0xFFFF,
        description="Intensity that the camera itself rejects, counts; none = as it is.",
    )
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

    def _open(self) -> None:
        self._library = load_library(find_library(self.options.library))
        with self._lock:
            self._handle = connect(self._library, self.options.address, self.options.serial)
            try:
                self._set_up()
            except BaseException as error:
                self._close()
                if isinstance(error, OperationError):
                    raise InitialisationError(f"the camera could not be set up: {error}") from error
                raise

    def _set_up(self) -> None:
        call, handle = self._library.call, self._handle
        self._shape = (call("SR_GetRows", handle), call("SR_GetCols", handle))
        self._model = model_of(product_of(self._library, handle), self.options.model)
        self._serial = serial_of(self._library, handle)
        self._mode = Mode(self.options.acquire_mode) if self.options.acquire_mode else self._model.mode
        self._adjuster = Adjuster(self._library, handle, self._model, self._mode)
        self._adjuster.auto_exposure(self.options.auto_exposure)
        if self.options.saturation_threshold is not None:
            self._adjuster.saturation_threshold(self.options.saturation_threshold)
        if self.options.dual_integration is not None:
            self._adjuster.dual_integration(self.options.dual_integration)
        self._acquirer = Acquirer(
            self._library, handle, self.clock, lambda: self._exposure_bounds(self._integration_time())
        )
        in_force = self._adjuster.read()
        self._settings = self._apply(self._wanted if self._wanted is not None else in_force)
        self._wanted = self._settings if self._wanted is None else self._wanted

    def _close(self) -> None:
        with self._lock:
            handle, self._handle = self._handle, c_void_p()
            if handle.value:
                disconnect(self._library, handle)

    def _start(self) -> None:
        self._pacer.start()

    def _stop(self) -> None:
        pass

    def _grab(self, timeout: float) -> Frame:
        deadline = self.clock.now() + round(timeout * 1e9)
        self._pacer.wait(self._settings.frame_rate, deadline)
        with self._lock:
            shortest, _ = self._exposure_bounds(self._integration_time())
            if deadline - self.clock.now() <= shortest * 1e9:
                raise DeviceTimeoutError(
                    "no frame was asked for: the time allowed is shorter than an exposure"
                )
            self._sequence += 1
            deadline += self._acquirer.prepare(deadline)
            integration_time = self._integration_time()
            return self._frame(*self._acquirer.acquire(deadline), integration_time)

    def _integration_time(self) -> float:
        """Seconds per sample of the frame to be asked for next; the library adapts it after each one."""
        if self.options.auto_exposure:
            return self._adjuster.read_integration_time()
        return self._settings.integration_time

    def _exposure_bounds(self, integration_time: float) -> tuple[float, float]:
        shortest, longest = self._model.exposure_bounds(integration_time)
        if self.options.dual_integration:
            readout = longest - shortest
            longest += SAMPLES * integration_time * self.options.dual_integration / 100 + readout
        return shortest, longest

    def _longest_exposure(self, integration_time: float | None) -> float:
        longest = self._model.exposure.longest if integration_time is None else integration_time
        return self._exposure_bounds(longest)[1]

    def _frame(self, requested: int, finished: int, integration_time: float) -> Frame:
        if self._moves != self._library.moves:
            self._find_images()
        settings = self._settings
        rows, columns = self._shape
        timestamp, uncertainty = mid_exposure(
            requested,
            finished,
            *self._exposure_bounds(integration_time),
            frame_bytes=rows * columns * 4,
            waits=bool(self._mode & Mode.SOFTWARE_TRIGGER),
        )
        counts = copy_image(self._images[DISTANCE], self._shape)
        if CONFIDENCE in self._kinds:
            counts[copy_image(self._images[CONFIDENCE], self._shape) == 0] = 0
        return Frame(
            counts=counts,
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

    def _apply(self, settings: CameraSettings) -> CameraSettings:
        with self._lock:
            self._acquirer.settings_changed()
            taken = self._adjuster.apply(settings)
            self._find_images()
        self._wanted = settings
        return taken

    def _find_images(self) -> None:
        """A change of mode can move the images: their addresses are asked for anew."""
        self._moves = self._library.moves
        self._images = image_addresses(self._library, self._handle, self._shape, self._kinds)

    @property
    def _kinds(self) -> tuple[int, ...]:
        wanted = (DISTANCE, AMPLITUDE)
        return (*wanted, CONFIDENCE) if self._mode & Mode.CONFIDENCE else wanted

    def _calibration(self) -> Calibration:
        if self._known_calibration is None:
            self._known_calibration = self._measured_lens()
        return self._known_calibration

    def _measured_lens(self) -> Calibration:
        nominal = self._model.calibration
        if self._library.has("SR_CoordTrfPntFlt"):
            try:
                with self._lock:
                    rays = pixel_rays(self._library, self._handle, self._shape)
                return fit_lens(rays, nominal, "rays of the vendor's library")
            except OperationError as error:
                log.warning("%s; the nominal optics are used", error)
        if nominal is None:
            raise InitialisationError(
                f"optics of the {self._model.name} are in no public source, and this library gives none: "
                "measure them with `lidarboost calibrate intrinsics`"
            )
        return nominal

    def _capabilities(self) -> Capabilities:
        return Capabilities(
            shape=self._shape,
            source="device",
            carries_pose=False,
            model=self._model.name,
            serial=self._serial,
        )
