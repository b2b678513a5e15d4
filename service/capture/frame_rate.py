"""How evenly frames come: rate, jitter, and what is missing between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from drivers.frame import Frame
from service.errors import ServiceError


class FrameRate(BaseModel):
    """What was seen of a run of frames; times are those of the exposures."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    frames: int
    seconds: float = Field(description="From the first frame to the last.")
    rate: float = Field(description="Frames per second that arrived.")
    camera_rate: float = Field(description="Frames per second that the camera took, lost ones included.")
    period: float = Field(description="Median time from one frame to the next, ms.")
    jitter: float = Field(description="Standard deviation of that time where none is missing, ms.")
    longest: float = Field(description="Longest time from one frame to the next, ms.")
    dropped: int = Field(description="Frames missing, by the gaps in their numbers.")
    out_of_order: int = Field(description="Frames not later than the one before.")
    uncertainty: float = Field(description="Largest uncertainty of a timestamp, ms.")

    def __str__(self) -> str:
        disorder = f", {self.out_of_order} out of order" if self.out_of_order else ""
        return (
            f"{self.rate:.2f} frames/s over {self.frames} frames in {self.seconds:.1f} s; period "
            f"{self.period:.2f} ms, jitter {self.jitter:.2f} ms (σ), longest {self.longest:.2f} ms; "
            f"{self.dropped} dropped (the camera took {self.camera_rate:.2f} frames/s){disorder}; timestamps "
            f"to ± {self.uncertainty:.2f} ms"
        )


def frame_rate(frames: Sequence[tuple[int, int, int]]) -> FrameRate:
    """Rate, jitter and drops.

    Args:
        frames: (sequence, timestamp, timestamp uncertainty) of each frame, in ns, as `numbers_of` gives them.

    Raises:
        ServiceError: fewer than three frames.
    """
    if len(frames) < 3:
        raise ServiceError(f"{len(frames)} frames came, at least three make a rate: wait longer")
    sequence, timestamp, uncertainty = np.array(frames, dtype=np.int64).T
    apart, steps = np.diff(timestamp) / 1e6, np.diff(sequence)
    seconds = float(timestamp[-1] - timestamp[0]) / 1e9
    whole = apart[steps == 1]
    missing = int(np.maximum(steps - 1, 0).sum())
    taken = len(frames) - 1
    return FrameRate(
        frames=len(frames),
        seconds=seconds,
        rate=taken / seconds if seconds > 0 else 0.0,
        camera_rate=(taken + missing) / seconds if seconds > 0 else 0.0,
        period=float(np.median(whole if whole.size else apart)),
        jitter=float(whole.std()) if whole.size else 0.0,
        longest=float(apart.max()),
        dropped=missing,
        out_of_order=int(np.sum(apart <= 0)),
        uncertainty=float(uncertainty.max()) / 1e6,
    )


def numbers_of(frame: Frame) -> tuple[int, int, int]:
    """What `frame_rate` needs of a frame."""
    return frame.sequence, frame.timestamp, frame.timestamp_uncertainty
