"""What a run did: for people at its end, and as JSON."""

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.names import Shown
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.messages.quality import Errors, judge
from service.messages.report import BurstReport

_WORTH_SAYING = 1e-3
"""Share of contradicted samples from which something was in the way: 4e-5 are usual at dark places."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class BurstSummary(_Part):
    """One fused burst."""

    report: BurstReport
    errors: Errors | None = Field(description="None where there is no truth of the map's size.")


class RunSummary(_Part):
    """One run of the service."""

    source: str = Field(description="Where the frames came from.")
    model: str = Field(description="What camera.")
    frames: int = Field(ge=0, description="Frames captured into bursts.")
    stale: int = Field(ge=0, description="Frames thrown away because the stage still moved.")
    dropped_frames: int = Field(ge=0, description="Frames that the camera took and that never arrived.")
    bursts: int = Field(ge=0, description="Bursts captured.")
    fused: tuple[BurstSummary, ...] = Field(description="The last bursts fused (at most 1000).")
    maps: int = Field(ge=0, description="Bursts fused.")
    published: int = Field(ge=0, description="Messages handed to the publisher.")
    files: tuple[Shown, ...] = Field(description="Files written.")
    seconds: float = Field(ge=0, description="From opening the devices to the last thing handed over.")
    lost: tuple[Shown, ...] = Field(description="What was lost, in words; empty = nothing.")


def summary_of(event: MapFused) -> BurstSummary:
    """A map's report, with its errors where there is a truth; made once."""
    return event.once(summary_of, lambda: summarize(event.map, event.truth))


def summarize(result: FusedMap, truth: NDArray[np.float32] | None) -> BurstSummary:
    """A map's report, with its errors against a truth (βH, βW) of its size, metres."""
    return BurstSummary(report=result.report, errors=judge(result, truth))


def describe(burst: BurstSummary) -> str:
    """One burst in one line, with units."""
    report, errors = burst.report, burst.errors
    parts = [
        f"burst {report.burst}: {len(report.used)} of {report.frames + report.missing} frames",
        f"{report.width} × {report.height} pixels",
        report.method + ("" if report.regularization is None else f", λ {report.regularization:.3g}"),
    ]
    if errors is not None:
        parts.append(
            f"RMS error {errors.rms * 1000:.1f} mm, mean absolute {errors.mean_absolute * 1000:.1f} mm "
            f"(one frame: {errors.nearest_rms * 1000:.1f} and {errors.nearest_mean_absolute * 1000:.1f} mm)"
        )
    elif report.deviation is not None:
        parts.append(f"median deviation {report.deviation * 1000:.1f} mm")
    parts.append(f"{report.seconds.total:.2f} s")
    if report.contradicted >= _WORTH_SAYING:
        parts.append(f"{report.contradicted:.1%} of the samples contradict the others, or are too far")
    if report.missing:
        parts.append(f"{report.missing} frames missing")
    if not report.converged:
        parts.append(f"not converged after {report.iterations} iterations")
    return "; ".join(parts)
