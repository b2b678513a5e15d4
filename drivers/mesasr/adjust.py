"""Settings through libMesaSR: what a model can take, set and read back."""

import logging
from ctypes import c_void_p

from drivers.errors import InitialisationError, OperationError
from drivers.exposure import SAMPLES
from drivers.mesasr.library import Library
from drivers.mesasr.models import AUTO_EXPOSURE_OFF, Mode, Model, frequency_numbers
from drivers.settings import CameraSettings

log = logging.getLogger(__name__)

AUTO_EXPOSURE = ("SR_SetAutoExposure", "SR_SetAutoIllumination")
"""The same control under its present name and that of 2008 (vendor headers)."""

FIRMWARE_REGISTER, DUAL_FIRMWARE, NO_FIRMWARE = 46, 0x73, 0xFF
"""Register of an SR4000's firmware version, the first version with a second integration time, and the value
where there is none (vendor's self-test and header)."""


class Adjuster:
    """Sets and reads one camera's settings; the caller holds the camera's lock.

    Args:
        mode: acquire mode without the gray bit, which a setting governs.
    """

    def __init__(self, library: Library, handle: c_void_p, model: Model, mode: Mode) -> None:
        self._library = library
        self._handle = handle
        self._model = model
        self._mode = mode & ~Mode.GRAY

    def read(self) -> CameraSettings:
        """What is in force in the camera; the mode is ours, so amplitudes are linear."""
        return CameraSettings(
            integration_time=self.read_integration_time(),
            modulation_frequency=self._read_frequency(),
            amplitude_threshold=self._read_threshold(),
        )

    def read_integration_time(self) -> float:
        """Seconds per sample."""
        exposure = self._model.exposure
        value = self._library.call("SR_GetIntegrationTime", self._handle)
        # an SR2A counts from zero: its shortest exposure is one step
        return float(exposure.offset + exposure.step * value) or exposure.step

    def apply(self, settings: CameraSettings) -> CameraSettings:
        """Set everything; returns it with the integration time as the camera took it.

        Raises:
            InitialisationError: the model cannot take a value; nothing was set.
            OperationError: the library refused one.
        """
        value = self._register_value(settings.integration_time)
        time = self._model.exposure.offset + self._model.exposure.step * value
        if settings.frame_rate is not None and settings.frame_rate * SAMPLES * time > 1:
            raise self._refused(
                f"{settings.frame_rate:g} frames/s",
                f"an integration time of {time * 1e3:g} ms allows less than {1 / (SAMPLES * time):.1f}",
            )
        frequency = self._frequency_number(settings.modulation_frequency)
        self._check_threshold(settings.amplitude_threshold)

        gray = Mode.GRAY if settings.amplitude_mode == "gray" else Mode(0)
        self._set("SR_SetMode", 0, int(self._mode | gray))
        if frequency is not None:
            self._set_frequency(frequency, settings.modulation_frequency)
        self._set("SR_SetIntegrationTime", 2, value)
        if settings.amplitude_threshold != self._read_threshold():
            self._set("SR_SetAmplitudeThreshold", 4, settings.amplitude_threshold)
        return settings.model_copy(update={"integration_time": time})

    def auto_exposure(self, on: bool) -> None:
        """Switch the library's control of the integration time on or off."""
        name = next(filter(self._library.has, AUTO_EXPOSURE), None)
        arguments = self._model.auto_exposure if on else AUTO_EXPOSURE_OFF
        if arguments is None:
            raise self._refused("auto exposure", "no values are documented that work for it")
        if name is not None:
            self._set(name, 0, *arguments)
        elif on:
            raise self._refused("auto exposure", f"{self._library.path} has no {AUTO_EXPOSURE[0]}")

    def saturation_threshold(self, counts: int) -> None:
        """Let the camera itself reject pixels whose intensity exceeds this."""
        self._require("a saturation threshold", "SR_SetSaturationThreshold")
        self._set("SR_SetSaturationThreshold", 0, counts)

    def dual_integration(self, percent: int) -> None:
        """Expose each frame a second time, for this share of the integration time; 0 = once."""
        self._require("a second integration time", "SR_SetDualIntegrationTime", "SR_GetReg")
        firmware = self._library.call("SR_GetReg", self._handle, FIRMWARE_REGISTER)
        if not DUAL_FIRMWARE <= firmware < NO_FIRMWARE:
            raise self._refused(
                "a second integration time",
                f"its firmware is 0x{firmware:02x}, needed is 0x{DUAL_FIRMWARE:x}",
            )
        self._set("SR_SetDualIntegrationTime", 2, percent)

    def _require(self, what: str, *names: str) -> None:
        missing = [name for name in names if not self._library.has(name)]
        if missing:
            raise self._refused(what, f"{self._library.path} has no {' and no '.join(missing)}")

    def _register_value(self, time: float) -> int:
        exposure = self._model.exposure
        value = round((time - exposure.offset) / exposure.step)
        if not 0 <= value <= 0xFF:
            low, high = (exposure.offset + exposure.step * end for end in (0, 0xFF))
            raise self._refused(
                f"an integration time of {time * 1e3:g} ms", f"it takes {low * 1e3:g} to {high * 1e3:g} ms"
            )
        return value

    def _frequency_number(self, frequency: float) -> int | None:
        """The library's number for a frequency; None where it is in force already."""
        if frequency == self._read_frequency():
            return None
        if frequency not in self._model.frequencies:
            allowed = ", ".join(f"{known / 1e6:g}" for known in self._model.frequencies)
            raise self._refused(f"{frequency / 1e6:g} MHz", f"it takes {allowed} MHz")
        if not self._library.has("SR_SetModulationFrequency"):
            raise self._refused(f"{frequency / 1e6:g} MHz", "this library cannot set the frequency")
        numbers = frequency_numbers(self._library.version, self._library.path)
        if frequency not in numbers:
            raise self._refused(f"{frequency / 1e6:g} MHz", f"{self._library.path} does not know it")
        return numbers.index(frequency)

    def _set_frequency(self, number: int, frequency: float) -> None:
        self._set("SR_SetModulationFrequency", 0, number)
        # some builds report success whatever happens
        if (got := self._read_frequency()) != frequency:
            raise OperationError(
                f"asked for {frequency / 1e6:g} MHz, the camera stays at {got / 1e6:g} MHz"
                f"{self._library.explain()}"
            )
        log.warning(
            "modulation frequency set to %g MHz: a camera is calibrated at one frequency, at others its "
            "distances are biased",
            frequency / 1e6,
        )

    def _read_frequency(self) -> float:
        numbers = frequency_numbers(self._library.version, self._library.path)
        number = self._library.call("SR_GetModulationFrequency", self._handle)
        if not 0 <= number < len(numbers):
            raise OperationError(f"SR_GetModulationFrequency gave {number}{self._library.explain()}")
        return float(numbers[number])

    def _check_threshold(self, threshold: int) -> None:
        if threshold and not self._library.has("SR_SetAmplitudeThreshold"):
            raise self._refused("an amplitude threshold", "this library cannot set it")

    def _set(self, name: str, success: int, *values: int) -> None:
        result = self._library.call(name, self._handle, *values)
        if result < success:
            arguments = ", ".join(map(str, values))
            raise OperationError(f"{name}({arguments}) gave {result}{self._library.explain()}")

    def _read_threshold(self) -> int:
        if not self._library.has("SR_GetAmplitudeThreshold"):
            return 0  # the camera's default (vendor header)
        return int(self._library.call("SR_GetAmplitudeThreshold", self._handle))

    def _refused(self, what: str, why: str) -> InitialisationError:
        return InitialisationError(f"the {self._model.name} cannot be given {what}: {why}")
