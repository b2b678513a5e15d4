"""How the noise of the distance depends on the amplitude, from frames of a still scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, NoiseLaw
from drivers.frame import Frame
from service.calibration.still import Still, reduce_still
from service.errors import CalibrationError

BINS = 16
"""Groups of pixels of like amplitude, evenly spaced in its logarithm, so that the law holds over all of its
range and not only where most pixels are."""

LEAST_SAMPLES = 200
"""Of a group: its σ is then known to 5 %."""

CLIP = 5.0
"""Robust deviations beyond which a value is no noise."""

WRAPPED = 0.02
"""Noise of more than this share of the ambiguity range is no longer small: it wraps, and grows no further
(a uniform distance has 0.29)."""

LEAST_BINS = 6
"""Groups that remain, to call it a law."""

LEAST_CONTRAST = 2.0
"""Brightest over darkest group: below that, the scene says nothing about how noise depends on amplitude."""


@dataclass(frozen=True)
class NoiseFit:
    """What was found.

    Attributes:
        law: σ = coefficient / amplitude.
        amplitude, sigma: (M,) of each group of pixels, counts and metres.
        trusted: (M,) groups that the law rests on.
        slope: of log σ against log amplitude: −1 for the law, −0.5 for pure shot noise of a constant
            background.
        scatter: relative scatter of the groups about the law.
        frames: how many.
        integration_time: seconds, or None.
    """

    law: NoiseLaw
    amplitude: NDArray[np.float64]
    sigma: NDArray[np.float64]
    trusted: NDArray[np.bool_]
    slope: float
    scatter: float
    frames: int
    integration_time: float | None

    def apply(self, calibration: Calibration) -> Calibration:
        """`calibration` with this law."""
        return calibration.model_copy(update={"noise": self.law})

    def __str__(self) -> str:
        bright, dark = self.amplitude[self.trusted].max(), self.amplitude[self.trusted].min()
        c = self.law.coefficient
        return (
            f"σ = {c:.4g} m / amplitude (counts), from {self.frames} frames: {1e3 * c / bright:.1f} mm at "
            f"{bright:.0f} counts, {1e3 * c / dark:.1f} mm at {dark:.0f}; slope of log σ {self.slope:.2f}, "
            f"scatter about the law {100 * self.scatter:.0f} %"
        )


def calibrate_noise(scenes: Sequence[Sequence[Frame]]) -> NoiseFit:
    """Fit σ = c / amplitude to still frames.

    Args:
        scenes: frames of one or more still scenes, at least two of each; nothing moves within a scene.

    Raises:
        CalibrationError: too few frames, something moved, or too little contrast.
    """
    stills = [reduce_still(frames) for frames in scenes]
    if not stills or min(still.frames for still in stills) < 2:
        raise CalibrationError("noise is what differs between frames: at least two of each scene are needed")
    if any(still.amplitude is None for still in stills):
        raise CalibrationError(
            "the camera gives no amplitude, on which its noise could depend; nothing can be calibrated here"
        )
    times = {still.integration_time for still in stills}
    if len(times) > 1:
        raise CalibrationError(f"the scenes differ in integration time ({times}); calibrate one at a time")
    amplitude, sigma = _groups(stills)
    trusted = (sigma > 0) & (sigma < WRAPPED * stills[0].ambiguity_range) & (amplitude > 0)
    bright = amplitude[trusted]
    if trusted.sum() < LEAST_BINS or bright.max() < LEAST_CONTRAST * bright.min():
        raise CalibrationError(
            f"{trusted.sum()} of {len(amplitude)} groups of pixels have a usable noise, with amplitudes of "
            f"{np.nan_to_num(bright.min() if bright.size else 0):.0f} to "
            f"{np.nan_to_num(bright.max() if bright.size else 0):.0f} counts; at least {LEAST_BINS} groups "
            f"and a factor of {LEAST_CONTRAST:g} are needed: show a scene with bright and dark things"
        )
    products = sigma[trusted] * bright
    coefficient = float(np.sqrt(np.mean(products**2)))
    slope = float(np.polyfit(np.log(bright), np.log(sigma[trusted]), 1)[0])
    return NoiseFit(
        law=NoiseLaw(coefficient=coefficient),
        amplitude=amplitude,
        sigma=sigma,
        trusted=trusted,
        slope=slope,
        scatter=float(np.std(np.log(products / coefficient))),
        frames=sum(still.frames for still in stills),
        integration_time=stills[0].integration_time,
    )


def _groups(stills: Sequence[Still]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Amplitude and σ of each group of pixels of like amplitude."""
    amplitude = np.concatenate([np.broadcast_to(_light(s), s.deviations.shape)[_usable(s)] for s in stills])
    deviation = np.concatenate([s.deviations[_usable(s)] for s in stills])
    darkest, brightest = np.percentile(amplitude[amplitude > 0], (1, 99.5))
    edges = np.geomspace(darkest, brightest, BINS + 1)
    found = []
    for low, high in pairwise(edges):
        group = deviation[(amplitude >= low) & (amplitude < high)]
        if group.size >= LEAST_SAMPLES:
            found.append((np.sqrt(low * high), _clipped_rms(group)))
    return np.array([a for a, _ in found]), np.array([sigma for _, sigma in found])


def _clipped_rms(deviation: NDArray[np.float64]) -> float:
    """RMS without what something that moved, or a pixel that wrapped, has left."""
    # The median absolute deviation of a normal variable is 0.6745 σ.
    limit = CLIP * float(np.median(np.abs(deviation))) / 0.6745
    return float(np.sqrt(np.mean(deviation[np.abs(deviation) <= limit] ** 2)))


def _light(still: Still) -> NDArray[np.float64]:
    assert still.amplitude is not None
    return still.amplitude


def _usable(still: Still) -> NDArray[np.bool_]:
    seen = np.isfinite(_light(still)) & np.isfinite(still.distance)
    return np.broadcast_to(seen, still.deviations.shape)
