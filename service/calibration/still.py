"""Frames of a scene in which nothing moves, reduced to one image with its noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from service.errors import CalibrationError

TURNED = np.radians(0.05)
"""By as much as a stage that stands still may report other angles: a sixth of a pixel."""


@dataclass(frozen=True)
class Still:
    """The mean of several frames of a still scene.

    Attributes:
        frames: how many.
        distance: (H, W) mean distance, metres; NaN where some frame has none.
        amplitude: (H, W) mean amplitude, linear in the received light, counts; NaN likewise. None = the
            camera gives none.
        deviations: (N, H, W) of each frame's distance from the mean, metres, scaled so that their mean square
            estimates the variance of one frame.
        ambiguity_range: metres; infinite where distances do not wrap.
        integration_time: seconds, or None = not known.
    """

    frames: int
    distance: NDArray[np.float64]
    amplitude: NDArray[np.float64] | None
    deviations: NDArray[np.float64]
    ambiguity_range: float
    integration_time: float | None


def reduce_still(frames: Sequence[Frame]) -> Still:
    """Average frames taken with the same settings, the distance modulo the ambiguity range.

    Raises:
        CalibrationError: no frames, frames of different sizes or settings, or a stage that turned meanwhile.
    """
    if not frames:
        raise CalibrationError("there are no frames; record a still scene first: lidarboost capture")
    settings = {(f.shape, f.ambiguity_range, f.integration_time, f.amplitude_mode) for f in frames}
    if len(settings) > 1:
        raise CalibrationError(
            f"the {len(frames)} frames were taken with {len(settings)} different settings; expected the same "
            "size, frequency and integration time in all of them: calibrate one setting at a time"
        )
    turn = float(np.ptp([(frame.pan, frame.tilt) for frame in frames], axis=0).max())
    if turn > TURNED:
        raise CalibrationError(
            f"the stage turned by {np.degrees(turn):.2f}° between the {len(frames)} frames; expected a "
            "camera at rest: record them by lidarboost capture, not by a scan"
        )
    period = frames[0].ambiguity_range or np.inf
    distance = np.stack([frame.distance for frame in frames]).astype(np.float64)
    first = distance[0]
    away = distance - first
    if np.isfinite(period):
        away = np.mod(away + period / 2, period) - period / 2
    mean = away.mean(axis=0)
    spread = np.sqrt(len(frames) / (len(frames) - 1)) if len(frames) > 1 else np.nan
    return Still(
        frames=len(frames),
        distance=np.mod(first + mean, period),
        amplitude=_amplitude(frames),
        deviations=(away - mean) * spread,
        ambiguity_range=period,
        integration_time=frames[0].integration_time,
    )


def _amplitude(frames: Sequence[Frame]) -> NDArray[np.float64] | None:
    """(H, W) mean linear amplitude in counts, NaN where some frame has no distance."""
    total = np.zeros(frames[0].shape)
    for frame in frames:
        if frame.signal is None:
            return None
        linear = frame.signal.astype(np.float64) * (frame.integration_time or 1.0)
        total += np.where(frame.valid, linear, np.nan)
    return total / len(frames)
