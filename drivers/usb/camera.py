"""A SwissRanger over plain USB."""

import logging
from pathlib import Path

from pydantic import Field

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.device import BackendOptions
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    DriverError,
    InitialisationError,
    NotAvailableError,
    OperationError,
)
from drivers.frame import Frame
from drivers.pacing import Pacer
from drivers.settings import CameraSettings, Capabilities
from drivers.usb.adjust import check_settings, initial_settings, register_writes
from drivers.usb.discovery import UsbDevice, find_cameras
from drivers.usb.findings import describe_sending
from drivers.usb.profile import Profile, require_usable, usable
from drivers.usb.reader import FrameReader
from drivers.usb.steps import RegisterWrite
from drivers.usb.transport import Transport

log = logging.getLogger(__name__)

MAX_FAILURES = 5
"""Failed frames in a row after which the camera counts as lost, so that it is opened afresh."""


class UsbOptions(BackendOptions):
    """Which camera to open, and how far to trust what is known of it."""

    model: str | None = Field(None, description="SR2A, SR2B, SR3000 or SR4000; none = told by its USB id.")
    profile: Path | None = Field(None, description="Profile file, for example one learned from a trace.")
    serial: str | None = Field(None, description="Serial number; none = the first camera found.")
    allow_inferred: bool = Field(
        False, description="Use entries of the profile that are inferred or learned, not documented."
    )
    saturation_level: int = Field(
        0x8000, ge=1, le=0xFFFF, description="Amplitude from which a pixel counts as saturated, counts."
    )


class UsbCamera(Camera):
    """Takes frames one by one, on request.

    A frame that fails leaves a gap in the sequence. Settings outlive `close`: when the camera is opened
    again, for example after it was plugged in again, they are applied again.
    """

    Options = UsbOptions
    options: UsbOptions

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        super().__init__(options, clock)
        self._transport: Transport | None = None
        self._reader: FrameReader | None = None
        self._device: UsbDevice | None = None
        self._profile: Profile | None = None
        self._wanted: CameraSettings | None = None
        self._written: tuple[RegisterWrite, ...] | None = None
        self._integration_time: float | None = None
        self._sequence = 0
        self._failures = 0
        self._pacer = Pacer(self.clock)

    def _open(self) -> None:
        consent = self.options.allow_inferred
        device, profile = self._choose()
        require_usable(profile, consent or self.options.profile is not None)
        if self.options.profile is not None:
            self._require_consent(self.options.profile, profile)
        try:
            self._transport = Transport(device, profile, consent, self.clock)
            self._reader = FrameReader(self._transport, profile, self.clock, self._sequence)
            self._device, self._profile = device, profile
            self._written = None
            self._transport.run(profile.initialise.known)
            self._settings = self._apply(self._wanted or initial_settings(profile, consent))
        except BaseException as error:
            self._close()
            if isinstance(error, DeviceLostError):
                raise NotAvailableError(f"{error} while it was being opened") from error
            if isinstance(error, OperationError):
                raise InitialisationError(f"the camera could not be set up: {error}") from error
            raise

    def _require_consent(self, path: Path, profile: Profile) -> None:
        """A profile of one's own, whatever it says of itself, needs consent to what it sends."""
        sends = "; ".join(describe_sending(profile))
        if not self.options.allow_inferred:
            raise InitialisationError(
                f"{path}: a profile of one's own is used only with allow_inferred = true; nothing was sent. "
                f"With it, {sends}"
            )
        log.warning("%s: %s", path, sends)
        if profile.serial is None:
            log.warning("%s is bound to no serial number: it is used for any %s", path, profile.model)

    def _close(self) -> None:
        transport, self._transport, self._reader = self._transport, None, None
        if transport is None:
            return
        try:
            transport.run(self._known.finish.known)
        except DriverError as error:
            log.debug("closing: %s", error)
        finally:
            transport.release()

    def _choose(self) -> tuple[UsbDevice, Profile]:
        options = self.options
        extra = Profile.load(options.profile) if options.profile is not None else None
        found = find_cameras(extra)
        fitting = [
            device
            for device in found
            if (options.serial is None or device.serial == options.serial)
            and (extra is None or extra in device.profiles)
            and (options.model is None or any(p.model == options.model for p in device.profiles))
        ]
        if not fitting:
            raise NotAvailableError(_nothing_found(options, found))
        if extra is not None and extra.serial is not None:
            others, fitting = fitting, [device for device in fitting if device.serial == extra.serial]
            if not fitting:
                raise InitialisationError(
                    f"{options.profile} is for the camera with the serial number {extra.serial}, and would "
                    f"be sent to {others[0]}; nothing was sent: learn a profile of this one"
                )
        # after unplugging, the camera in the same socket is the one to go on with
        port = self._device.port if self._device is not None else None
        device = next((device for device in fitting if device.port == port), fitting[0])
        return device, extra or _only_profile(device, options.model)

    def _start(self) -> None:
        self._failures = 0
        self._pacer.start()

    def _stop(self) -> None:
        pass

    def _grab(self, timeout: float) -> Frame:
        deadline = self.clock.now() + round(timeout * 1e9)
        self._pacer.wait(self._settings.frame_rate, deadline)
        shortest, _ = self._known.exposure_bounds(self._integration_time)
        if deadline - self.clock.now() <= shortest * 1e9:
            raise DeviceTimeoutError("no frame was asked for: the time allowed is shorter than an exposure")
        assert self._reader is not None
        try:
            counts, amplitude, timestamp, uncertainty = self._reader.take(deadline, self._integration_time)
        except DeviceLostError:
            raise
        except OperationError as error:
            self._after_failure(error)
            raise
        except NotAvailableError as error:  # the permission was taken away meanwhile
            raise DeviceLostError(str(error)) from error
        finally:
            self._sequence = self._reader.number
        self._failures = 0
        return Frame(
            counts=counts,
            amplitude=amplitude,
            timestamp=timestamp,
            timestamp_uncertainty=uncertainty,
            sequence=self._sequence,
            pan=0.0,
            tilt=0.0,
            integration_time=self._integration_time,
            modulation_frequency=self._settings.modulation_frequency,
            ambiguity_range=self._settings.ambiguity_range,
            saturation_level=self.options.saturation_level,
        )

    def _after_failure(self, error: OperationError) -> None:
        """Tell a lost camera from one bad frame."""
        self._failures += 1
        if self._failures >= MAX_FAILURES or not self._is_plugged_in():
            failures = f"{self._failures} failed frames in a row, last: {error}"
            raise DeviceLostError(f"{self._device} is lost ({failures})") from error

    def _is_plugged_in(self) -> bool:
        try:
            there = {(device.bus, device.address) for device in find_cameras(self._known)}
        except NotAvailableError:
            return False
        return self._device is not None and (self._device.bus, self._device.address) in there

    def _apply(self, settings: CameraSettings) -> CameraSettings:
        consent = self.options.allow_inferred
        taken = check_settings(settings, self._known, consent)
        assert self._transport is not None
        assert self._reader is not None
        writes = tuple(register_writes(taken, self._known, consent))
        if writes and writes != self._written:
            self._reader.settings_changed()
        self._written = None
        for step in writes:
            self._transport.send(step)
        self._written = writes
        if usable(self._known.registers.integration_time, consent):
            self._integration_time = taken.integration_time
        self._wanted = settings
        return taken

    def _longest_exposure(self, integration_time: float | None) -> float:
        return self._known.exposure_bounds(integration_time)[1]

    def _calibration(self) -> Calibration:
        return self._known.nominal_calibration()

    def _capabilities(self) -> Capabilities:
        image = self._known.image
        return Capabilities(
            shape=(image.rows.known, image.columns.known),
            source="device",
            carries_pose=False,
            model=self._known.model,
            serial=self._device.serial if self._device is not None else None,
        )

    @property
    def _known(self) -> Profile:
        assert self._profile is not None
        return self._profile


def _only_profile(device: UsbDevice, model: str | None) -> Profile:
    fitting = [profile for profile in device.profiles if model in (None, profile.model)]
    if len(fitting) > 1:
        raise InitialisationError(f"{device}: its id does not tell which; set model to one of them")
    return fitting[0]


def _nothing_found(options: UsbOptions, found: list[UsbDevice]) -> str:
    asked = " ".join(filter(None, (options.model, options.serial and f"with serial {options.serial}")))
    if found:
        return f"no camera {asked or 'that fits the profile'}; there are: {'; '.join(map(str, found))}"
    return "no SwissRanger found on USB: plug it in, switch it on, and look for it with `lidarboost devices`"
