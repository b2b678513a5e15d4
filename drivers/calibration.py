"""What is known of a camera's geometry and errors, saved as TOML and inside every recording."""

import logging
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from drivers.documents import parse_toml, told
from drivers.errors import RecordingError

LENS_TERMS = (4, 5, 8, 12, 14)
"""How many terms OpenCV's lens model may have."""

Metres = Annotated[float, Field(ge=-1000, le=1000)]
Radians = Annotated[float, Field(ge=-100, le=100)]
_Pixels = Annotated[float, Field(ge=-1e6, le=1e6)]

_log = logging.getLogger(__name__)


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Intrinsics(_Part):
    """Pinhole projection in pixels; integer coordinates are pixel centres."""

    fx: float = Field(ge=1, le=1e6, description="Focal length along columns, pixels.")
    fy: float = Field(ge=1, le=1e6, description="Focal length along rows, pixels.")
    cx: _Pixels = Field(description="Column of the principal point, pixels.")
    cy: _Pixels = Field(description="Row of the principal point, pixels.")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) camera matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


class CyclicTerm(_Part):
    """One harmonic of the cyclic error: amplitude · sin(2π · harmonic · distance / range + phase)."""

    amplitude: float = Field(ge=0, le=1000, description="Amplitude of the error, metres.")
    harmonic: int = Field(ge=1, le=16, description="Periods of the error within one ambiguity range.")
    phase: Radians = Field(description="Phase at distance zero, radians.")


class Corrections(_Part):
    """Systematic distance errors; they are subtracted from what the camera delivers."""

    constant: Metres = Field(0.0, description="Constant offset, metres.")
    cyclic: tuple[CyclicTerm, ...] = Field((), description="Harmonics of the modulation's cyclic error.")
    per_pixel: tuple[tuple[Metres, ...], ...] = Field(
        (), description="Offset of each pixel, metres; empty = none."
    )

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self.constant or self.cyclic or self.per_pixel)

    def error(self, distance: NDArray[np.floating], ambiguity_range: float | None) -> NDArray[np.float64]:
        """(H, W) metres by which measured distances (H, W) are too long.

        Raises:
            RecordingError: a cyclic error without an ambiguity range.
        """
        error = np.full(distance.shape, self.constant)
        for term in self.cyclic:
            if ambiguity_range is None:
                raise RecordingError(
                    "the calibration has a cyclic error, and the frames have no ambiguity range: give a "
                    "calibration of their camera"
                )
            phase = 2 * np.pi * term.harmonic * distance / ambiguity_range + term.phase
            error += term.amplitude * np.sin(phase)
        if self.per_pixel:
            error += np.asarray(self.per_pixel)
        return error


class Mount(_Part):
    """How the camera sits on the stage, at pan = tilt = 0.

    Stage axes: x right, y down, z forward, as the camera's when it is mounted straight.
    """

    rotation: tuple[Radians, Radians, Radians] = Field(
        (0.0, 0.0, 0.0), description="Rotation vector that takes camera axes to stage axes, radians."
    )
    lever_arm: tuple[Metres, Metres, Metres] = Field(
        (0.0, 0.0, 0.0), description="Projection centre from the stage's axes, in stage axes, metres."
    )


class Footprint(_Part):
    """The area over which a pixel averages."""

    fill_factor: float = Field(1.0, gt=0, le=1, description="Side of the sensitive square, in pixel pitches.")
    blur: float = Field(0.0, ge=0, le=5, description="Standard deviation of the lens blur, pixels.")


class NoiseLaw(_Part):
    """σ(distance) = coefficient / amplitude, amplitude linear in the received light, in counts."""

    coefficient: float = Field(ge=1e-9, le=1e9, description="Metres times counts.")

    def for_signal(self, integration_time: float | None) -> float:
        """The coefficient for `Frame.signal`, which is per second where the integration time is known."""
        return self.coefficient if integration_time is None else self.coefficient / integration_time


class Calibration(_Part):
    """Everything known of one camera on its mount.

    Raises:
        ValueError: per-pixel offsets that do not fit the image, or a number of lens terms that OpenCV's model
            does not have.
    """

    width: int = Field(ge=2, le=65536, description="Columns.")
    height: int = Field(ge=2, le=65536, description="Rows.")
    intrinsics: Intrinsics
    distortion: tuple[float, ...] = Field((), max_length=14, description="OpenCV's k1, k2, p1, p2, k3, ….")
    corrections: Corrections = Corrections()
    mount: Mount = Mount()
    footprint: Footprint = Footprint()
    noise: NoiseLaw | None = Field(None, description="None = not measured; the solver estimates it.")
    source: str = Field("nominal", description="Where these figures come from.")

    @field_validator("distortion")
    @classmethod
    def _is_a_lens(cls, terms: tuple[float, ...]) -> tuple[float, ...]:
        if terms and len(terms) not in LENS_TERMS:
            known = ", ".join(map(str, LENS_TERMS))
            raise ValueError(f"{len(terms)} terms; expected none or OpenCV's {known}")
        return terms

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

    def correct(self, distance: NDArray[np.float32], ambiguity_range: float | None) -> NDArray[np.float32]:
        """Distance with the systematic errors taken out, modulo the ambiguity range.

        Args:
            distance: (H, W) metres as delivered, NaN where there is none.
            ambiguity_range: metres; None = distances do not wrap.

        Returns:
            (H, W) float32 metres in [0, ambiguity_range); without a range, NaN where they would not be
            positive.

        Raises:
            RecordingError: as `Corrections.error`.
        """
        if not self.corrections:
            return distance
        error = self.corrections.error(distance, ambiguity_range)
        if ambiguity_range is None:
            left = distance - error
            return np.where(left > 0, left, np.nan).astype(np.float32)
        corrected: NDArray[np.float32] = np.mod(distance - error, ambiguity_range).astype(np.float32)
        return corrected

    def to_toml(self) -> str:
        """The calibration as TOML text."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))

    @classmethod
    def from_toml(cls, text: str | bytes, origin: str = "calibration") -> Self:
        """Read TOML text as a recording holds it; keys that a newer version added are told and passed over.

        Raises:
            RecordingError: not TOML, or values out of bounds; names each of them.
        """
        return cls._read(text, origin, strict=False)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a TOML file, where an unknown key is an error: it would be a slip of the pen.

        Raises:
            RecordingError: as `from_toml`, or the file cannot be read.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise RecordingError(f"{path}: cannot read the calibration ({error.strerror})") from error
        return cls._read(content, str(path), strict=True)

    @classmethod
    def _read(cls, text: str | bytes, origin: str, *, strict: bool) -> Self:
        try:
            found = parse_toml(text if isinstance(text, bytes) else text.encode())
        except ValueError as error:
            raise RecordingError(f"{origin}: {error}") from error
        try:
            return cls._known(found, origin, strict=strict)
        except ValidationError as error:
            raise RecordingError(f"{origin}: not a calibration ({told(error)})") from error

    @classmethod
    def _known(cls, found: dict[str, Any], origin: str, *, strict: bool) -> Self:
        try:
            return cls.model_validate(found)
        except ValidationError as error:
            unknown = [fault["loc"] for fault in error.errors() if fault["type"] == "extra_forbidden"]
            if strict or not unknown:
                raise
        names = ", ".join(".".join(map(str, place)) for place in unknown)
        _log.warning("%s: passed over what this version does not know: %s", origin, names)
        for *tables, key in unknown:
            inner: Any = found
            for name in tables:
                inner = inner[name]
            del inner[key]
        return cls.model_validate(found)

    def save(self, path: Path) -> None:
        """Write a TOML file, whole or not at all."""
        partial = path.with_name(path.name + ".partial")
        partial.write_text(self.to_toml(), encoding="utf-8")
        partial.replace(path)


def sr2b_calibration() -> Calibration:
    """Nominal SR2B: 124 × 160 pixels of 54.8 µm × 39.2 µm behind an 8 mm lens, centre (62, 80).

    Source: camDataSR2B.xml in the vendor's Linux package (pixel counts, sizes and centre column first).
    """
    return Calibration(
        width=124,
        height=160,
        intrinsics=Intrinsics(fx=8e-3 / 54.8e-6, fy=8e-3 / 39.2e-6, cx=62.0, cy=80.0),
        source="nominal SR2B optics",
    )


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


def sr4500_calibration() -> Calibration:
    """One SR4500, as a public driver has it (OpenPTrack, SR4500_calib.yaml); each camera differs a little."""
    return Calibration(
        width=176,
        height=144,
        intrinsics=Intrinsics(fx=148.907, fy=148.635, cx=87.308, cy=70.886),
        distortion=(-0.37008, 0.16793, 0.00031, -0.0002),
        source="one SR4500 of a public driver (OpenPTrack)",
    )
