"""Settings of a camera over plain USB: which it can take, and the registers that hold them."""

from collections.abc import Iterator

from drivers.errors import InitialisationError
from drivers.exposure import SAMPLES
from drivers.settings import CameraSettings
from drivers.usb.profile import Exposure, Fact, Profile, usable
from drivers.usb.steps import RegisterWrite


def initial_settings(profile: Profile, allow_inferred: bool) -> CameraSettings:
    """Settings of a freshly opened camera; the integration time is nominal where it cannot be written."""
    exposure = profile.exposure
    initial = exposure.known.initial if usable(exposure, allow_inferred) else 0.01
    return CameraSettings(integration_time=initial, modulation_frequency=profile.modulation_frequency.known)


def check_settings(settings: CameraSettings, profile: Profile, allow_inferred: bool) -> CameraSettings:
    """The settings as the camera will take them: the integration time rounded to its step.

    Raises:
        InitialisationError: a value that the camera, or what is known of it, does not allow.
    """
    initial = initial_settings(profile, allow_inferred)
    if settings.modulation_frequency != initial.modulation_frequency:
        raise _refused(
            profile,
            f"a modulation frequency of {settings.modulation_frequency / 1e6:g} MHz",
            f"over plain USB it stays at {initial.modulation_frequency / 1e6:g} MHz, for the register is not "
            "known",
        )
    if settings.amplitude_mode != "linear":
        raise _refused(profile, "gray amplitudes", "they are computed by the vendor's library")
    if settings.amplitude_threshold and not usable(profile.registers.amplitude_threshold, allow_inferred):
        raise _refused(profile, "an amplitude threshold", _why_not(profile.registers.amplitude_threshold))
    time = _integration_time(settings, initial, profile, allow_inferred)
    _check_frame_rate(settings, time, profile, allow_inferred)
    return settings.model_copy(update={"integration_time": time})


def register_writes(
    settings: CameraSettings, profile: Profile, allow_inferred: bool
) -> Iterator[RegisterWrite]:
    """What to write so that checked settings are in force."""
    registers = profile.registers
    if usable(registers.integration_time, allow_inferred):
        value = _register_value(settings.integration_time, profile.exposure.known)
        yield RegisterWrite(number=registers.integration_time.known, value=value)
    if usable(registers.amplitude_threshold, allow_inferred):
        high, low = registers.amplitude_threshold.known
        yield RegisterWrite(number=high, value=settings.amplitude_threshold >> 8)
        yield RegisterWrite(number=low, value=settings.amplitude_threshold & 0xFF)


def _integration_time(
    settings: CameraSettings, initial: CameraSettings, profile: Profile, allow_inferred: bool
) -> float:
    register = profile.registers.integration_time
    if not usable(register, allow_inferred):
        if settings.integration_time == initial.integration_time:
            return initial.integration_time
        raise _refused(profile, "an integration time", _why_not(register))
    exposure = profile.exposure.known
    value = _register_value(settings.integration_time, exposure)
    if not 0 <= value <= 0xFF:
        low, high = (exposure.offset + exposure.step * end for end in (0, 0xFF))
        raise _refused(
            profile,
            f"an integration time of {settings.integration_time * 1e3:g} ms",
            f"it takes {low * 1e3:g} to {high * 1e3:g} ms",
        )
    return exposure.offset + exposure.step * value


def _check_frame_rate(settings: CameraSettings, time: float, profile: Profile, allow_inferred: bool) -> None:
    if settings.frame_rate is None:
        return
    if not usable(profile.registers.integration_time, allow_inferred):
        # what is in force is not known: only what no integration time allows is impossible
        time = profile.exposure.value.offset if profile.exposure.value is not None else 0.0
    shortest = SAMPLES * (time + (profile.readout.value or 0.0))
    if settings.frame_rate * shortest > 1:
        raise _refused(
            profile,
            f"{settings.frame_rate:g} frames/s",
            f"an integration time of {time * 1e3:g} ms allows at most {1 / shortest:.1f} frames/s",
        )


def _register_value(time: float, exposure: Exposure) -> int:
    return round((time - exposure.offset) / exposure.step)


def _why_not(fact: Fact[int] | Fact[tuple[int, int]]) -> str:
    if fact.value is None:
        return f"the register is not known. {fact.source}"
    return f"the register is only {fact.confidence} ({fact.source}); allow_inferred = true permits it"


def _refused(profile: Profile, what: str, why: str) -> InitialisationError:
    return InitialisationError(f"the {profile.model} cannot be given {what}: {why}")
