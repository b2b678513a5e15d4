"""What the vendor's header says of each model: frequencies, modes, exposure."""

from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path

from drivers.errors import InitialisationError
from drivers.usb.profile import Exposure, Profile, shipped_profiles


class Mode(IntFlag):
    """Bits of the acquire mode (vendor header)."""

    FIXED_PATTERN_CORRECTION = 0x01
    MEDIAN = 0x04
    GRAY = 0x10
    CONFIDENCE = 0x100
    SOFTWARE_TRIGGER = 0x400


FREQUENCIES = (40e6, 30e6, 21e6, 20e6, 19e6, 60e6, 15e6, 10e6, 29e6, 31e6, 14.5e6, 15.5e6)
"""Hz by number, libMesaSR 1.0.14 (vendor header)."""

OLD_FREQUENCIES = (30e6, 21e6, 20e6, 19e6)
"""Hz by number, libusbSR of 2007 (vendor header)."""

NEW_NUMBERING = (1, 0, 14)
"""First version whose header shows the newer numbers; those between are not documented."""


@dataclass(frozen=True)
class Model:
    """One model.

    Attributes:
        mode: acquire mode for measuring: filters off; with the software trigger, where there is one, so that
            an exposure never begins before it is asked for.
        frequencies: Hz that the header lists for it.
        auto_exposure: arguments of the vendor's control that work well.
        profile: its entry among the USB profiles: exposure formula, optics.
    """

    name: str
    mode: Mode
    frequencies: tuple[float, ...]
    auto_exposure: tuple[int, int, int, int]
    profile: Profile

    @property
    def exposure(self) -> Exposure:
        return self.profile.exposure.known


AUTO_EXPOSURE_OFF = (255, 0, 0, 0)

_SR3K = ((40e6, 30e6, 21e6, 20e6, 19e6), (5, 255, 10, 45))
_SR4K = ((30e6, 15e6, 29e6, 31e6), (1, 150, 5, 70))
_CORRECTED = Mode.FIXED_PATTERN_CORRECTION
_MODES = {
    "SR2A": (_CORRECTED, *_SR3K),
    "SR2B": (_CORRECTED, *_SR3K),
    "SR3000": (_CORRECTED, *_SR3K),
    "SR4000": (_CORRECTED | Mode.CONFIDENCE | Mode.SOFTWARE_TRIGGER, *_SR4K),
}


def model_of(product: int | None, name: str | None) -> Model:
    """The model with a USB product id, or the one named.

    Raises:
        InitialisationError: unknown, or the id is shared and the name is missing.
    """
    fitting = [
        profile
        for profile in shipped_profiles()
        if profile.model == name or (name is None and product in {known.product for known in profile.ids})
    ]
    if len(fitting) != 1:
        which = f"product id 0x{product:04x}" if product is not None else "the camera's answer"
        raise InitialisationError(
            f"{name or which} does not tell the model: set `model` to one of {', '.join(_MODES)}"
        )
    profile = fitting[0]
    mode, frequencies, auto_exposure = _MODES[profile.model]
    return Model(profile.model, mode, frequencies, auto_exposure, profile)


def frequency_numbers(version: tuple[int, ...] | None, path: Path) -> tuple[float, ...]:
    """Hz by number for this build of the library.

    Raises:
        InitialisationError: a build whose numbers are not documented.
    """
    if path.name.startswith("libusbSR"):
        return OLD_FREQUENCIES
    if version is not None and version >= NEW_NUMBERING:
        return FREQUENCIES
    shown = ".".join(map(str, version)) if version is not None else "without a version"
    raise InitialisationError(
        f"{path} is version {shown}; how it numbers modulation frequencies is documented from 1.0.14 on: "
        "install that"
    )
