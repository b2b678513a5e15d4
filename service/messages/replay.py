"""How a recording is being played: the payload of `replay/state`."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

MOST_GAPS = 20
"""Gaps that are told one by one."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class ReplayGap(_Part):
    """Where the recording's clock jumps; it is cut short where it is played."""

    frame: int = Field(ge=0, description="The first frame after it, from 0.")
    seconds: float = Field(description="By how much, seconds; < 0 = backwards.")


class ReplayState(_Part):
    """Where a replay is; 5 Hz while it plays, 1 Hz otherwise, and at once after a change."""

    timestamp: int = Field(0, description="When this was true, ns since the epoch.")
    file: str | None = Field(None, description="What is played, in the recording folder; none = nothing.")
    mode: Literal["scan", "stream"] | str = Field(
        "scan", description="A map of each burst, or of the last frames with every frame."
    )
    playing: bool = Field(False, description="Whether it goes on by itself.")
    ended: bool = Field(False, description="Whether the last frame was played.")
    speed: float | None = Field(1.0, description="Times real time; none = as fast as it can be fused.")
    loop: bool = Field(False, description="Whether it begins again at the end.")
    round: int = Field(0, ge=0, description="How often it has begun again.")
    seconds: float = Field(
        0.0, ge=0, description="Where it is, seconds from the first frame, gaps cut short."
    )
    duration: float = Field(0.0, ge=0, description="From the first frame to the last, gaps cut short.")
    frame: int = Field(0, ge=0, description="The next frame, from 0.")
    frames: int = Field(0, ge=0, description="How many there are.")
    burst: int = Field(0, ge=0, description="The burst that the next frame belongs to, from 0.")
    bursts: int = Field(0, ge=0, description="How many there are.")
    recorded: int | None = Field(
        None, description="When the next frame was taken, ns since the epoch; none = at the end."
    )
    gaps: tuple[ReplayGap, ...] = Field((), description="Where its clock jumps: the first twenty.")
    gap_count: int = Field(0, ge=0, description="How often it jumps.")
    error: str | None = Field(None, description="Why it stands still; none = because it was told to.")
