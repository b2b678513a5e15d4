"""What every importer delivers, and what it may be told."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.calibration import Calibration
from drivers.depth.reading import DepthReading
from drivers.errors import RecordingError
from drivers.frame import AmplitudeMode


class ImportOptions(BaseModel):
    """What a file does not say itself; None = what its format or camera usually has."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    integration_time: float | None = Field(None, gt=0, le=0.1, description="Seconds per phase sample.")
    modulation_frequency: float | None = Field(None, ge=1e6, le=100e6, description="Hz.")
    frame_rate: float | None = Field(
        None, gt=0, le=1000, description="Frames per second of files without times."
    )
    amplitude_mode: AmplitudeMode | None = Field(None, description="`linear`, or `gray`: times distance².")
    calibration: Calibration | None = Field(None, description="The camera's; None = nominal for its model.")
    reading: DepthReading = Field(DepthReading(), description="What the values of depth images stand for.")
    topic: str | None = Field(None, description="Depth images of a bag; None = the only ones there are.")
    amplitude: str | None = Field(
        None,
        description="Topic, or folder, of amplitude images that belong to the depth images; None = none.",
    )
    camera_info: str | None = Field(None, description="Topic of the optics; None = beside the depth images.")
    rectified: bool | None = Field(
        None, description="Whether the images have no distortion left; None = where the topic says rect."
    )
    accept_inferred: bool = Field(
        False, description="Read formats of which a part is only inferred, not documented."
    )


@dataclass(frozen=True, slots=True)
class Exposure:
    """One exposure as a file holds it.

    Attributes:
        counts: (H, W) uint16, radial, 65536 = one ambiguity range, 0 = rejected.
        amplitude: (H, W) uint16.
        time: ns since the file's own zero; None = the file does not say.
        integration_time: seconds per phase sample; None = the file does not say.
    """

    counts: NDArray[np.uint16]
    amplitude: NDArray[np.uint16]
    time: int | None
    integration_time: float | None = None


@dataclass(frozen=True, slots=True)
class Source:
    """The camera behind a file, as far as its format tells.

    Attributes:
        model: for people.
        serial: serial number, or None.
        calibration: from the files, or nominal for the model; None = nothing is known of its optics.
        modulation_frequency: Hz, what the model usually runs at; None = none, or not known.
        amplitude_mode: what the format usually holds.
        optics_residual: pixels, root mean square, of the fit of the optics to the files; None = not fitted.
    """

    model: str
    serial: str | None
    calibration: Calibration | None
    modulation_frequency: float | None
    amplitude_mode: AmplitudeMode
    optics_residual: float | None = None

    def carrier(self, options: ImportOptions) -> float:
        """The modulation frequency as told, else the model's, Hz."""
        known = options.modulation_frequency or self.modulation_frequency
        assert known is not None, "a SwissRanger has one"
        return known


@dataclass(slots=True)
class Findings:
    """What a reader has to say beside the frames.

    Attributes:
        notes: what was assumed or looks odd, one line each.
        lost: what could not be read.
    """

    notes: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Say something once."""
        if text not in self.notes:
            self.notes.append(text)

    def lose(self, text: str) -> None:
        """Say once what could not be read."""
        if text not in self.lost:
            self.lost.append(text)


def check_size(shape: tuple[int, ...], calibration: Calibration, path: Path) -> None:
    """Raise `RecordingError` where a frame and its calibration have different sizes."""
    if shape != calibration.shape:
        raise RecordingError(
            f"{path}: its frame has {_size(shape)} pixels, its calibration is for "
            f"{_size(calibration.shape)}: name files and calibration of one camera"
        )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[0]} × {shape[1]}"
