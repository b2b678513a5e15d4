"""What can be set on a camera, and what a camera can do."""

from dataclasses import dataclass
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from drivers.frame import AmplitudeMode, Frame, ambiguity_range

LONGEST_INTEGRATION_TIME = 0.1
"""Seconds per sample that no camera exceeds: the longest known takes 65.28 ms (SR2A, vendor header)."""


class CameraSettings(BaseModel):
    """Settings that every camera understands; a camera refuses values that it cannot take."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    integration_time: float = Field(
        0.030,
        ge=1e-6,
        le=LONGEST_INTEGRATION_TIME,
        description="Seconds per phase sample; a frame takes four.",
    )
    modulation_frequency: float = Field(20e6, ge=1e6, le=100e6, description="Modulation frequency, Hz.")
    frame_rate: float | None = Field(
        None,
        ge=1e-3,
        le=1000,
        description="Frames per second; none = as fast as the integration time allows.",
    )
    amplitude_threshold: int = Field(
        0, ge=0, le=0xFFFF, description="Counts under which the camera itself rejects a pixel; 0 = none."
    )
    amplitude_mode: AmplitudeMode = Field(
        "linear", description="`linear` in the received light, or `gray`: multiplied by distance²."
    )

    @property
    def ambiguity_range(self) -> float:
        """Metres."""
        return ambiguity_range(self.modulation_frequency)

    def over(self, others: Self) -> Self:
        """Others with those changed that were named when this was made."""
        return others.model_copy(update={name: getattr(self, name) for name in self.model_fields_set})


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a camera is.

    Attributes:
        shape: (rows, columns) of its images.
        source: `device` for hardware, `replay` for a recording, `simulation`.
        carries_pose: its frames bring their own stage angles, burst and pose (a recording does).
        model: what it is, for people.
        serial: serial number, or None where it has none.
    """

    shape: tuple[int, int]
    source: Literal["device", "replay", "simulation"]
    carries_pose: bool
    model: str
    serial: str | None = None


def recorded_settings(frame: Frame) -> CameraSettings:
    """Settings as they were; nominal integration time and frequency where the recording knows none."""
    known = {
        name: value
        for name in ("integration_time", "modulation_frequency")
        if (value := getattr(frame, name)) is not None
    }
    return CameraSettings.model_construct(
        **{
            **CameraSettings().model_dump(),
            **known,
            "amplitude_mode": frame.amplitude_mode,
        }
    )
