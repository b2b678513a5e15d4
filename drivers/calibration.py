"""What is known of a camera's geometry and errors, saved as TOML and inside every recording."""

import tomllib
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.errors import RecordingError


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Intrinsics(_Part):
    """Pinhole projection in pixels; integer coordinates are pixel centres."""

    fx: float = Field(gt=0, description="Focal length along columns, pixels.")
    fy: float = Field(gt=0, description="Focal length along rows, pixels.")
    cx: float = Field(description="Column of the principal point, pixels.")
    cy: float = Field(description="Row of the principal point, pixels.")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) camera matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


class CyclicTerm(_Part):
    """One harmonic of the cyclic error: amplitude · sin(2π · harmonic · distance / range + phase)."""

    amplitude: float = Field(ge=0, description="Amplitude of the error, metres.")
    harmonic: int = Field(ge=1, le=16, description="Periods of the error within one ambiguity range.")
    phase: float = Field(description="Phase at distance zero, radians.")


class Corrections(_Part):
    """Systematic distance errors; they are subtracted from what the camera delivers."""

    constant: float = Field(0.0, description="Constant offset, metres.")
    cyclic: tuple[CyclicTerm, ...] = Field((), description="Harmonics of the modulation's cyclic error.")
    per_pixel: tuple[tuple[float, ...], ...] = Field(
        (), description="Offset of each pixel, metres; empty = none."
    )

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self.constant or self.cyclic or self.per_pixel)

    def error(self, distance: NDArray[np.floating], ambiguity_range: float) -> NDArray[np.float64]:
        """(H, W) metres by which measured distances (H, W) are too long."""
        error = np.full(distance.shape, self.constant)
        for term in self.cyclic:
            phase = 2 * np.pi * term.harmonic * distance / ambiguity_range + term.phase
            error += term.amplitude * np.sin(phase)
        if self.per_pixel:
            error += np.asarray(self.per_pixel)
        return error


class Mount(_Part):
    """How the camera sits on the stage, at pan = tilt = 0.

    Stage axes: x right, y down, z forward, as the camera's when it is mounted straight.
    """

    rotation: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Rotation vector that takes camera axes to stage axes, radians."
    )
    lever_arm: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Projection centre from the stage's axes, in stage axes, metres."
    )


class Footprint(_Part):
    """The area over which a pixel averages."""

    fill_factor: float = Field(1.0, gt=0, le=1, description="Side of the sensitive square, in pixel pitches.")
    blur: float = Field(0.0, ge=0, le=5, description="Standard deviation of the lens blur, pixels.")


class NoiseLaw(_Part):
    """σ(distance) = coefficient / amplitude, amplitude linear in the received light, in counts."""

    coefficient: float = Field(gt=0, description="Metres times counts.")

    def for_signal(self, integration_time: float | None) -> float:
        """The coefficient for `Frame.signal`, which is per second where the integration time is known."""
        return self.coefficient if integration_time is None else self.coefficient / integration_time


class Calibration(_Part):
    """Everything known of one camera on its mount.

    Raises:
        ValueError: per-pixel offsets that do not fit the image.
    """

    width: int = Field(ge=2, le=4096, description="Columns.")
    height: int = Field(ge=2, le=4096, description="Rows.")
    intrinsics: Intrinsics
    distortion: tuple[float, ...] = Field((), max_length=14, description="OpenCV's k1, k2, p1, p2, k3, ….")
    corrections: Corrections = Corrections()
    mount: Mount = Mount()
    footprint: Footprint = Footprint()
    noise: NoiseLaw | None = Field(None, description="None = not measured; the solver estimates it.")
    source: str = Field("nominal", description="Where these figures come from.")

    @model_validator(mode="after")
    def _per_pixel_fits(self) -> Self:
        rows = self.corrections.per_pixel
        if rows and (len(rows) != self.height or any(len(row) != self.width for row in rows)):
            raise ValueError(f"per_pixel must have {self.height} rows of {self.width} values")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.height, self.width

    def correct(self, distance: NDArray[np.float32], ambiguity_range: float) -> NDArray[np.float32]:
        """Distance with the systematic errors taken out, modulo the ambiguity range.

        Args:
            distance: (H, W) metres as delivered, NaN where there is none.
            ambiguity_range: metres.

        Returns:
            (H, W) float32 metres in [0, ambiguity_range).
        """
        if not self.corrections:
            return distance
        error = self.corrections.error(distance, ambiguity_range)
        corrected: NDArray[np.float32] = np.mod(distance - error, ambiguity_range).astype(np.float32)
        return corrected

    def to_toml(self) -> str:
        """The calibration as TOML text."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))

    @classmethod
    def from_toml(cls, text: str, origin: str = "calibration") -> Self:
        """Read TOML text.

        Raises:
            RecordingError: not TOML, unknown keys, or values out of bounds; names each of them.
        """
        try:
            return cls.model_validate(tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise RecordingError(f"{origin}: not valid TOML ({error})") from error
        except ValidationError as error:
            faults = "; ".join(
                f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors()
            )
            raise RecordingError(f"{origin}: not a calibration ({faults})") from error

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a TOML file; raises as `from_toml`, or `RecordingError` where the file cannot be read."""
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise RecordingError(f"{path}: cannot read the calibration ({error})") from error
        return cls.from_toml(text, str(path))

    def save(self, path: Path) -> None:
        """Write a TOML file, whole or not at all."""
        partial = path.with_name(path.name + ".partial")
        partial.write_text(self.to_toml(), encoding="utf-8")
        partial.replace(path)


def sr3000_calibration() -> Calibration:
    """Nominal SR3000: 176 × 144 pixels of 40 µm behind an 8 mm lens, so f = 200 pixels, centred."""
    return Calibration(
        width=176,
        height=144,
        intrinsics=Intrinsics(fx=200.0, fy=200.0, cx=87.5, cy=71.5),
        source="nominal SR3000 optics",
    )


def sr4000_calibration() -> Calibration:
    """Measured on public frames of a real SR4000 (residual 0.007 px, at most 0.08 px).

    The lens is OpenCV's with k1, k2, k3: with two terms alone the corners are off by 3 mm at 4 m, with
    three every point of those frames comes back within 1 mm. The noise law σ = 3.8 · z² / A was measured on
    the same frames, A in gray mode, hence 3.8 / A with A made linear.
    """
    return Calibration(
        width=176,
        height=144,
        intrinsics=Intrinsics(fx=252.475, fy=252.475, cx=87.5, cy=71.5),
        distortion=(-0.92985, 0.75388, 0.0, 0.0, -0.17835),
        noise=NoiseLaw(coefficient=3.8),
        source="measured on public SR4000 frames",
    )
