"""What is known of one camera model, as data: a TOML file, every entry marked with how sure it is."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.calibration import Calibration, sr2b_calibration, sr3000_calibration, sr4000_calibration
from drivers.documents import parse_toml, told
from drivers.errors import InitialisationError
from drivers.exposure import SAMPLES
from drivers.settings import LONGEST_INTEGRATION_TIME
from drivers.usb.steps import Byte, Step, Word

Confidence = Literal["documented", "code", "measured", "inferred", "learned", "unknown"]

NEEDS_CONSENT: frozenset[Confidence] = frozenset({"inferred", "learned"})
"""Marks whose entries are used only with `allow_inferred`."""

Plane = Literal["distance", "amplitude", "intensity"]

CALIBRATIONS = {"sr2b": sr2b_calibration, "sr3000": sr3000_calibration, "sr4000": sr4000_calibration}

FOLDER = Path(__file__).parent / "profiles"

T = TypeVar("T")


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Fact(_Part, Generic[T]):
    """A value, how sure it is, and its source; for `unknown`, the source says how to find it out."""

    value: T | None = None
    confidence: Confidence
    source: str = Field(min_length=1)

    @model_validator(mode="after")
    def _value_unless_unknown(self) -> Self:
        if (self.value is None) != (self.confidence == "unknown"):
            raise ValueError("a value is needed, except where the confidence is `unknown`")
        return self

    @property
    def known(self) -> T:
        """The value; `open` has made sure beforehand that there is one."""
        if self.value is None:
            raise InitialisationError(f"the profile does not know this: {self.source}")
        return self.value


class UsbId(_Part):
    """Vendor and product id that a model answers to."""

    vendor: Word
    product: Word
    confidence: Confidence
    source: str

    def __str__(self) -> str:
        return f"{self.vendor:04x}:{self.product:04x}"


class Image(_Part):
    """Layout of one frame on the wire: 16-bit images, one after the other."""

    rows: Fact[Annotated[int, Field(ge=2, le=4096)]]
    columns: Fact[Annotated[int, Field(ge=2, le=4096)]]
    planes: Fact[tuple[Plane, ...]]
    byte_order: Fact[Literal["little", "big"]]
    significant_bits: Fact[Annotated[int, Field(ge=8, le=16)]]
    read_bytes: Fact[Annotated[int, Field(ge=1, le=1 << 24)]]

    @property
    def plane_bytes(self) -> int:
        return self.rows.known * self.columns.known * 2

    @property
    def frame_bytes(self) -> int:
        """Bytes that hold pixels; what is read beyond them is dropped."""
        return self.plane_bytes * len(self.planes.known)


class Exposure(_Part):
    """Integration time of a register value v: offset + step · v, in seconds; a frame takes four of them."""

    offset: float = Field(ge=0)
    step: float = Field(gt=0)
    initial: float = Field(gt=0, description="Seconds set when the camera is opened.")

    @property
    def longest(self) -> float:
        """Seconds at the largest register value."""
        return self.offset + 0xFF * self.step


class Registers(_Part):
    """Numbers of the registers that settings are written to."""

    integration_time: Fact[Byte]
    amplitude_threshold: Fact[tuple[Byte, Byte]]


class Profile(_Part):
    """One camera model."""

    model: str
    note: str = ""
    serial: str | None = Field(None, description="Serial number of the only camera it is for; none = any.")
    ids: tuple[UsbId, ...] = Field(min_length=1)
    interface: Fact[Byte]
    configuration: Fact[Byte]
    bulk_in: Fact[Annotated[int, Field(ge=0x81, le=0x8F)]]
    bulk_out: Fact[Annotated[int, Field(ge=1, le=0x0F)]]
    initialise: Fact[tuple[Step, ...]]
    trigger: Fact[tuple[Step, ...]]
    finish: Fact[tuple[Step, ...]]
    trigger_starts_exposure: Fact[bool]
    image: Image
    exposure: Fact[Exposure]
    readout: Fact[float]
    modulation_frequency: Fact[float]
    registers: Registers
    calibration: Fact[Literal["sr2b", "sr3000", "sr4000"]]

    @model_validator(mode="after")
    def _planes_are_enough(self) -> Self:
        planes = self.image.planes.value
        if planes is not None and not {"distance", "amplitude"} <= set(planes):
            raise ValueError("image.planes must hold `distance` and `amplitude`")
        read = self.image.read_bytes.value
        if planes and read and self.image.rows.value and read < self.image.frame_bytes:
            raise ValueError(f"image.read_bytes must be at least the frame's {self.image.frame_bytes}")
        return self

    def required(self) -> Iterator[tuple[str, Fact[Any]]]:
        """Entries without which no frame can be taken."""
        for name in ("interface", "bulk_in", "bulk_out", "initialise", "trigger", "finish"):
            yield name, getattr(self, name)
        for name in ("rows", "columns", "planes", "byte_order", "read_bytes"):
            yield f"image.{name}", getattr(self.image, name)
        yield "modulation_frequency", self.modulation_frequency

    def exposure_bounds(self, integration_time: float | None) -> tuple[float, float]:
        """Seconds that the exposure of a frame takes at least and at most; readout counts where it is known.

        Args:
            integration_time: seconds per sample, None = unknown.
        """
        return exposure_bounds(self.exposure.value, self.readout.value, integration_time)

    def nominal_calibration(self) -> Calibration:
        """Nominal optics of the model; raises `InitialisationError` where they are unknown."""
        if self.calibration.value is None:
            raise InitialisationError(f"optics of the {self.model} are not known: {self.calibration.source}")
        return CALIBRATIONS[self.calibration.value]()

    def to_toml(self) -> str:
        """The profile as TOML text."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True, exclude_defaults=False))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a profile.

        Raises:
            InitialisationError: the file cannot be read, is not TOML, or is no profile; says where.
        """
        try:
            return cls.model_validate(parse_toml(path.read_bytes()))
        except ValidationError as error:
            raise InitialisationError(f"{path}: not a camera profile ({told(error)})") from error
        except (OSError, ValueError) as error:
            raise InitialisationError(f"{path}: cannot read the camera profile ({error})") from error


def exposure_bounds(
    exposure: Exposure | None, readout: float | None, integration_time: float | None
) -> tuple[float, float]:
    """Seconds that the exposure of a frame takes at least and at most; readout counts where it is known.

    Args:
        exposure: of the model, None = unknown.
        readout: seconds after each sample, None = unknown.
        integration_time: seconds per sample, None = unknown.
    """
    at_most = integration_time
    if at_most is None:
        at_most = exposure.longest if exposure is not None else LONGEST_INTEGRATION_TIME
    return SAMPLES * (integration_time or 0.0), SAMPLES * (at_most + (readout or 0.0))


def shipped_profiles() -> list[Profile]:
    """The profiles that come with the package, by model name."""
    return [Profile.load(path) for path in sorted(FOLDER.glob("*.toml"))]


def usable(fact: Fact[T], allow_inferred: bool) -> bool:
    """Whether an entry may be used with the owner's consent as given."""
    return fact.value is not None and (allow_inferred or fact.confidence not in NEEDS_CONSENT)


def require_usable(profile: Profile, allow_inferred: bool) -> None:
    """Make sure that a profile is enough to take frames.

    Raises:
        InitialisationError: entries are unknown, or not sure and consent was not given; names them all.
    """
    unknown = [f"{name}: {fact.source}" for name, fact in profile.required() if fact.value is None]
    if unknown:
        raise InitialisationError(
            f"a {profile.model} cannot be driven over plain USB with what is known. " + " ".join(unknown)
        )
    unsure = [
        f"{name} ({fact.confidence}: {fact.source})"
        for name, fact in profile.required()
        if not usable(fact, allow_inferred)
    ]
    if unsure:
        raise InitialisationError(
            f"the profile of the {profile.model} holds entries that nobody has confirmed on a camera: "
            f"{'; '.join(unsure)}. Nothing was sent. Set allow_inferred = true to try them on your camera"
        )
