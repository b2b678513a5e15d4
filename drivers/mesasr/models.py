"""What is documented of each model behind the vendor's library: frequencies, modes, exposure, optics."""

from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path

from drivers.calibration import Calibration, sr4500_calibration
from drivers.errors import InitialisationError
from drivers.usb.profile import Exposure, exposure_bounds, shipped_profiles


class Mode(IntFlag):
    """Bits of the acquire mode (vendor header)."""

    FIXED_PATTERN_CORRECTION = 0x01
    MEDIAN = 0x04
    GRAY = 0x10
    CONFIDENCE = 0x100
    SOFTWARE_TRIGGER = 0x400


FREQUENCIES = (40e6, 30e6, 21e6, 20e6, 19e6, 60e6, 15e6, 10e6, 29e6, 31e6, 14.5e6, 15.5e6)
"""Hz by number (header of libMesaSR 1.0.14). The header of July 2008 (libusbSR) counts the first five alike;
that of 2007 began at 30 MHz, but its library takes other arguments and cannot be used at all."""

FIRST_VERSION, FULL_LIST = (1, 0, 10), (1, 0, 14)
"""Versions from which the first five numbers, and all of them, are those above."""

OLD_LIST = 5


@dataclass(frozen=True)
class Model:
    """One model.

    Attributes:
        mode: acquire mode for measuring: filters off; with the software trigger, where there is one, so that
            an exposure never begins before it is asked for.
        frequencies: Hz that are documented for it.
        auto_exposure: arguments of the vendor's control that work well; None = none are documented.
        exposure: integration time of a register value.
        readout: seconds after each sample, None = unknown.
        calibration: nominal optics, None = unknown.
    """

    name: str
    mode: Mode
    frequencies: tuple[float, ...]
    auto_exposure: tuple[int, int, int, int] | None
    exposure: Exposure
    readout: float | None
    calibration: Calibration | None

    def exposure_bounds(self, integration_time: float) -> tuple[float, float]:
        """Seconds that the exposure of a frame takes at least and at most."""
        return exposure_bounds(self.exposure, self.readout, integration_time)


AUTO_EXPOSURE_OFF = (255, 0, 0, 0)

_SR2 = (Mode.FIXED_PATTERN_CORRECTION, (20e6,), None)
_SR3K = (Mode.FIXED_PATTERN_CORRECTION, (40e6, 30e6, 21e6, 20e6, 19e6), (5, 255, 10, 45))
_SR4K = (
    Mode.FIXED_PATTERN_CORRECTION | Mode.CONFIDENCE | Mode.SOFTWARE_TRIGGER,
    (30e6, 15e6, 29e6, 31e6, 14.5e6, 15.5e6),
    (1, 150, 5, 70),
)
_MODELS = {"SR2A": _SR2, "SR2B": _SR2, "SR3000": _SR3K, "SR4000": _SR4K, "SR4500": _SR4K}
"""Mode, frequencies and auto exposure. An SR2's one frequency: RobWork's range of 7.5 m, and the vendor's
camera data. A public driver treats SR4000 and SR4500 alike (frequencies, formula of the exposure)."""


def model_of(product: int | None, name: str | None) -> Model:
    """The model with a USB product id, or the one named.

    Raises:
        InitialisationError: unknown, or the id is shared and the name is missing.
    """
    if name == "SR4500":  # on Ethernet only: it has no USB profile
        return _sr4500()
    fitting = [
        profile
        for profile in shipped_profiles()
        if profile.model == name or (name is None and product in {known.product for known in profile.ids})
    ]
    if len(fitting) != 1:
        which = f"product id 0x{product:04x}" if product is not None else "the camera's answer"
        raise InitialisationError(
            f"{name or which} does not tell the model: set `model` to one of {', '.join(_MODELS)}"
        )
    profile = fitting[0]
    optics = profile.nominal_calibration() if profile.calibration.value is not None else None
    return Model(
        profile.model, *_MODELS[profile.model], profile.exposure.known, profile.readout.value, optics
    )


def _sr4500() -> Model:
    like = model_of(None, "SR4000")
    return Model("SR4500", *_MODELS["SR4500"], like.exposure, like.readout, sr4500_calibration())


def frequency_numbers(version: tuple[int, ...] | None, path: Path) -> tuple[float, ...]:
    """Hz by number for this build of the library.

    Raises:
        InitialisationError: a build whose numbers are not documented.
    """
    if version is not None and version >= FULL_LIST:
        return FREQUENCIES
    if version is not None and version >= FIRST_VERSION:
        return FREQUENCIES[:OLD_LIST]
    shown = ".".join(map(str, version)) if version is not None else "without a version"
    raise InitialisationError(
        f"{path} is version {shown}; how it numbers modulation frequencies is documented from 1.0.10 on: "
        "install 1.0.14"
    )
