"""One exposure of the camera."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

COUNTS_PER_RANGE = 65536
"""Counts that span one ambiguity range (vendor header; confirmed on real frames by the quantisation step)."""

VENDOR_HALF_LIGHT_SPEED = 1.5e8
"""m/s; the vendor computes ranges with c = 3.0e8 m/s: 5.0000 m at 30 MHz, seen in real frames."""

AmplitudeMode = Literal["linear", "gray"]


def ambiguity_range(modulation_frequency: float) -> float:
    """Unambiguous range in metres at a modulation frequency in Hz, as the vendor computes it."""
    return VENDOR_HALF_LIGHT_SPEED / modulation_frequency


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure: what a depth camera saw at one time.

    Attributes:
        counts: (H, W) radial distance: uint16, metres = counts · `metres_per_count`, 0 = rejected; or
            float32, metres, rejected where not a positive number.
        amplitude: (H, W) uint16, received modulated light in counts; None = the camera gives none.
        timestamp: ns since the epoch, middle of the exposure.
        sequence: counted by the driver; a gap is a drop.
        pan, tilt: stage angles in radians while the frame was exposed (pan > 0 left, tilt > 0 up).
        integration_time: seconds per phase sample; None = not known.
        modulation_frequency: Hz; None = the light is not modulated, or it is not known how.
        ambiguity_range: metres at which distances wrap; None = they do not, or it is not known.
        scale: metres per count; None = ambiguity_range / 65536, as SwissRangers count.
        amplitude_mode: `linear` in the received light, or `gray`: the camera multiplied by distance²
            (in metres).
        timestamp_uncertainty: ns, half-width of the interval that surely holds the middle of the exposure.
        saturation_level: amplitude from which a pixel counts as saturated.
        burst, pose: which burst the frame belongs to and which pose of the plan it shows; None = not said.

    Raises:
        ValueError: arrays of the wrong type or shape, or counts of which no scale is known.
    """

    counts: NDArray[np.uint16] | NDArray[np.float32]
    amplitude: NDArray[np.uint16] | None
    timestamp: int
    sequence: int
    pan: float
    tilt: float
    integration_time: float | None
    modulation_frequency: float | None
    ambiguity_range: float | None
    amplitude_mode: AmplitudeMode = "linear"
    timestamp_uncertainty: int = 0
    saturation_level: int = 0xFFF0
    burst: int | None = None
    pose: int | None = None
    scale: float | None = None

    def __post_init__(self) -> None:
        _require_image("counts", self.counts, "uint16", "float32")
        if self.counts.dtype == np.uint16 and self.scale is None and self.ambiguity_range is None:
            raise ValueError("counts of unknown scale; expected ambiguity_range or scale")
        if self.amplitude is None:
            return
        _require_image("amplitude", self.amplitude, "uint16")
        if self.counts.shape != self.amplitude.shape:
            raise ValueError(
                f"counts {self.counts.shape} and amplitude {self.amplitude.shape} must have the same shape"
            )

    @property
    def has_amplitude(self) -> bool:
        return self.amplitude is not None

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.counts.shape[0], self.counts.shape[1]

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W), True where the sensor gave a distance and was not saturated."""
        if self.counts.dtype == np.uint16:
            usable: NDArray[np.bool_] = self.counts != 0
        else:
            usable = (self.counts > 0) & np.isfinite(self.counts)
        return usable if self.amplitude is None else usable & ~self.saturated

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(H, W), True where too much light came; nowhere, where the camera gives no amplitude."""
        if self.amplitude is None:
            return np.zeros(self.shape, dtype=np.bool_)
        reached: NDArray[np.bool_] = self.amplitude >= self.saturation_level
        return reached

    @property
    def metres_per_count(self) -> float:
        """What a count stands for; 1 for counts that are metres already."""
        if self.counts.dtype != np.uint16:
            return 1.0
        if self.scale is not None:
            return self.scale
        assert self.ambiguity_range is not None
        return self.ambiguity_range / COUNTS_PER_RANGE

    @cached_property
    def distance(self) -> NDArray[np.float32]:
        """(H, W) float32 radial distance in metres, NaN where rejected or saturated."""
        metres = self.counts * np.float32(self.metres_per_count)
        return np.where(self.valid, metres, np.float32(np.nan))

    @cached_property
    def signal(self) -> NDArray[np.float32] | None:
        """(H, W) float32 amplitude, linear in the received light, in counts per second of integration time.

        Counts themselves where the integration time is not known. In `gray` mode the camera's factor
        distance² is divided out, so pixels without a distance are NaN. None without amplitude.
        """
        if self.amplitude is None:
            return None
        signal = self.amplitude.astype(np.float32)
        if self.amplitude_mode == "gray":
            signal /= self.distance**2
        if self.integration_time is not None:
            signal /= np.float32(self.integration_time)
        return signal


def _require_image(name: str, image: object, *types: str) -> None:
    if not isinstance(image, np.ndarray) or image.dtype.name not in types or image.ndim != 2:
        expected = " or ".join(types)
        raise ValueError(f"{name}: expected a two-dimensional {expected} array, got {_describe(image)}")


def _describe(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} array of shape {value.shape}"
    return type(value).__name__
