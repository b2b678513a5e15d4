"""What a burst would give, before it is scanned: time, phases, parallax, exposure and noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.frame import Frame
from service.planning.estimate import PlanEstimate
from service.planning.plan import Plan

_BINS = 16

_MUCH_SATURATED, _MUCH_DARK = 0.01, 0.3
"""Shares of the pixels from which the exposure should be changed."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Exposure(_Part):
    """What the frames that were looked at say of the exposure."""

    frames: int = Field(ge=1, description="Frames looked at.")
    saturated: float = Field(ge=0, le=1, description="Share of the pixels with too much light.")
    dark: float = Field(ge=0, le=1, description="Share of the pixels rejected for other reasons.")
    histogram: tuple[int, ...] = Field(
        description="Pixels of one frame by amplitude, in equal steps; all 0 = it has none."
    )
    histogram_top: float = Field(description="Amplitude at the end of the last step, counts.")
    noise: float | None = Field(
        description="Median over the pixels of the distance's standard deviation from frame to frame, metres."
    )


class ScanCheck(_Part):
    """What a burst by the plan would give."""

    poses: int = Field(ge=1, description="Poses of the plan.")
    seconds: float = Field(ge=0, description="Time that one burst takes, about.")
    coverage: float = Field(
        ge=0, le=1, description="Share of the β × β sub-pixel phases that a pose falls in."
    )
    rows: float = Field(ge=0, le=1, description="Share of the β phases of the rows.")
    columns: float = Field(ge=0, le=1, description="Share of the β phases of the columns.")
    parallax: float = Field(
        ge=0, description="Pixels by which near and far things shift against each other, at most."
    )
    exposure: Exposure
    advice: tuple[str, ...] = Field(description="What could be better; empty = nothing.")


def check_scan(
    plan: Plan, estimate: PlanEstimate, frames: Sequence[Frame], *, settle: float, speed: float
) -> ScanCheck:
    """Put together what is known of a burst to come.

    Args:
        plan: to be run.
        estimate: of the plan.
        frames: at least one, of the stage at rest.
        settle: seconds to stand still at each pose.
        speed: of the stage, rad/s.
    """
    exposure = exposure_of(frames)
    return ScanCheck(
        poses=len(plan),
        seconds=_seconds(plan, frames, settle, speed),
        coverage=estimate.coverage,
        rows=estimate.rows,
        columns=estimate.columns,
        parallax=estimate.parallax,
        exposure=exposure,
        advice=(*estimate.warnings, *_advice(exposure)),
    )


def exposure_of(frames: Sequence[Frame]) -> Exposure:
    """How frames of the same view are exposed."""
    first = frames[0]
    saturated = np.stack([frame.saturated for frame in frames])
    valid = np.stack([frame.valid for frame in frames])
    amplitude = np.zeros(0) if first.amplitude is None else first.amplitude
    top = float(max(1, amplitude.max(initial=0))) * (1 + 1e-6)
    counts, _ = np.histogram(amplitude, bins=_BINS, range=(0.0, top))
    return Exposure(
        frames=len(frames),
        saturated=float(saturated.mean()),
        dark=float((~valid & ~saturated).mean()),
        histogram=tuple(counts.tolist()),
        histogram_top=top,
        noise=_noise(frames, np.asarray(valid.all(axis=0))),
    )


def _noise(frames: Sequence[Frame], known: NDArray[np.bool_]) -> float | None:
    if len(frames) < 2 or not known.any():
        return None
    distances = np.stack([frame.distance[known] for frame in frames]).astype(np.float64)
    return float(np.median(distances.std(axis=0, ddof=1)))


def _seconds(plan: Plan, frames: Sequence[Frame], settle: float, speed: float) -> float:
    """Each pose costs its way, the settling, and the frame that is under way at that time."""
    times = [frame.timestamp for frame in frames]
    period = float(np.median(np.diff(times))) * 1e-9 if len(times) > 1 else 0.0
    if not plan.moves:
        return period * len(plan)
    angles = np.array([(pose.pan, pose.tilt) for pose in (*plan.poses, plan.poses[0])])
    ways = np.abs(np.diff(angles, axis=0)).max(axis=1) / speed
    return float(ways.sum()) + len(plan) * (settle + 2 * period)


def _advice(exposure: Exposure) -> list[str]:
    found = []
    if exposure.saturated > _MUCH_SATURATED:
        found.append(
            f"{exposure.saturated:.0%} of the pixels have too much light: make "
            "settings.integration_time shorter"
        )
    if exposure.dark > _MUCH_DARK:
        found.append(
            f"{exposure.dark:.0%} of the pixels are too dark: make settings.integration_time longer, or "
            "settings.amplitude_threshold smaller"
        )
    return found
