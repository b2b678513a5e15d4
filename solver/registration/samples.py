"""The frames as samples with weights, at full and at pooled resolution."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.kernels.pooling import pool, write_phasors
from solver.registration.statistics import FLOOR, Statistics, some_of

Image = NDArray[np.float32]
Source = Literal["auto", "distance", "amplitude", "both"]

Mask = NDArray[np.bool_]
Channels = Callable[[Image, Image | None], tuple[Image, Mask, Image]]
"""Frames to values (C, N, H, W), which of them are known, and their deviation relative to each other."""

SMALLEST = 20  # pixels of the shorter side under which pooling leaves nothing to align


@dataclass(frozen=True, slots=True)
class Samples:
    """Values (C, N, H, W), weights 1/σ² (N, H, W; 0 = not used), and how often they were pooled by two.

    `bent`: a pixel that sees two surfaces need not have the mean of their values. Of all channels only those
    of phasors are sure to average linearly; a distance leans to the brighter side.
    """

    values: Image
    weights: Image
    level: int
    bent: bool

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.weights.shape[1], self.weights.shape[2]

    def joined(self, other: "Samples") -> "Samples":
        """The frames of both, of the same level."""
        return Samples(
            np.concatenate([self.values, other.values], axis=1),
            np.concatenate([self.weights, other.weights]),
            self.level,
            self.bent,
        )

    def pooled(self) -> "Samples":
        """Weighted 2 × 2 means; an odd last row or column is left out."""
        channels, count, height, width = self.values.shape
        mean = np.empty((channels, count, height // 2, width // 2), np.float32)
        total = np.empty(mean.shape[1:], np.float32)
        pool(self.values, self.weights, mean, total)
        return Samples(mean, total, self.level + 1, self.bent)


Scaling = Callable[[Image, Image | None], Samples]


def pyramid(samples: Samples) -> list[Samples]:
    """Full resolution first, then pooled while the shorter side allows, at most twice."""
    levels = [samples]
    while len(levels) < 3 and min(levels[-1].shape) >= 2 * SMALLEST:
        levels.append(levels[-1].pooled())
    return levels


def scaling(
    distance: Image, amplitude: Image | None, ambiguity_range: float | None, source: Source = "auto"
) -> Scaling:
    """What turns frames (distance, amplitude or None) into samples, scaled for these and alike for others.

    Channels average linearly over a pixel's footprint:

    - `distance`: the distance, weighted by the noise law σ = c / amplitude where amplitude is given.
    - `amplitude`: the amplitude.
    - `both`: the phasor amplitude · exp(2πi · distance / ambiguity range), as real and imaginary part;
      without an ambiguity range its first-order form, amplitude and amplitude · (distance − typical one).
      Noise is uniform there, and an edge is a ramp one pixel wide, whichever side is brighter.
    - `auto`: `both` where amplitude is given.

    Raises:
        FusionInputError: a source that needs amplitude, without amplitude.
    """
    channels: Channels
    if source == "distance" or (source == "auto" and amplitude is None):
        channels = _distance_channels(distance, amplitude)
    elif amplitude is None:
        raise FusionInputError(f"registration from {source!r} needs amplitude; give it, or use 'distance'")
    elif source == "amplitude":
        channels = _amplitude
    elif ambiguity_range is None:
        channels = _moment_channels(distance, amplitude)
    else:
        return _phasor_scaling(distance, amplitude, ambiguity_range)
    return partial(_weighted, channels, _statistics(channels, distance, amplitude))


def _statistics(channels: Channels, distance: Image, amplitude: Image | None) -> Statistics | None:
    """Of some pixels of some frames; of all where none of these is known."""
    part = some_of(distance.shape)
    light = None if amplitude is None else amplitude[part]
    some = Statistics.of(*channels(distance[part], light))
    return some if some is not None else Statistics.of(*channels(distance, amplitude))


def _phasor_scaling(distance: Image, amplitude: Image, ambiguity_range: float) -> Scaling:
    part = some_of(distance.shape)
    if not np.isfinite(distance[part] + amplitude[part]).any():
        part = slice(None), slice(None)
    known = np.isfinite(distance[part] + amplitude[part])
    light = np.where(known, amplitude[part], 0)
    angle = np.where(known, distance[part], 0) * np.float32(2 * np.pi / ambiguity_range)
    phasors = np.stack([light * np.cos(angle), light * np.sin(angle)])
    some = Statistics.of(phasors, known, np.ones_like(light))
    if some is None:
        return partial(_phasors, np.float32(0), np.zeros(2, np.float32), np.float32(0))
    return partial(_phasors, np.float32(1 / ambiguity_range), some.middle, some.factor(1))


def _phasors(
    rate: np.float32, middle: Image, factor: np.float32, distance: Image, amplitude: Image | None
) -> Samples:
    """Scaled and written in one pass: a burst's temporaries would cost more than the arithmetic."""
    values, weights = np.empty((2, *distance.shape), np.float32), np.empty(distance.shape, np.float32)
    write_phasors(distance, amplitude, rate, middle, factor, values, weights)
    return Samples(values, weights, 0, bent=False)


def _amplitude(distance: Image, amplitude: Image | None) -> tuple[Image, Mask, Image]:
    assert amplitude is not None
    valid = np.isfinite(distance) & np.isfinite(amplitude)
    light = np.where(valid, amplitude, 0)
    return light[None], valid, np.ones_like(light)


def _moment_channels(distance: Image, amplitude: Image) -> Channels:
    valid = np.isfinite(distance) & np.isfinite(amplitude)
    middle = np.float32(np.median(distance[valid]) if valid.any() else 0)
    scales = []
    # The moment is brought to the amplitude's noise, or to its range where there is no noise.
    for image in _moments(middle, np.float32(1), distance, amplitude)[0]:
        some = Statistics.of(image[None], valid, np.ones_like(image))
        scales.append(0.0 if some is None else np.sqrt(some.noise) + FLOOR * some.spread)
    return partial(_moments, middle, np.float32(scales[0] / scales[1] if scales[1] > 0 else 0))


def _moments(
    middle: np.float32, factor: np.float32, distance: Image, amplitude: Image | None
) -> tuple[Image, Mask, Image]:
    image, valid, even = _amplitude(distance, amplitude)
    moment = image[0] * np.where(valid, distance - middle, 0) * factor
    return np.stack([image[0], moment]), valid, even


def _distance_channels(distance: Image, amplitude: Image | None) -> Channels:
    typical = 1.0
    if amplitude is not None:
        lit = np.isfinite(distance) & np.isfinite(amplitude) & (amplitude > 0)
        typical = float(np.median(amplitude[lit])) if lit.any() else 1.0
    return partial(_distances, np.float32(typical))


def _distances(typical: np.float32, distance: Image, amplitude: Image | None) -> tuple[Image, Mask, Image]:
    valid = np.isfinite(distance)
    values = np.where(valid, distance, 0).astype(np.float32)
    relative = np.ones_like(values)
    if amplitude is not None:
        valid &= np.isfinite(amplitude) & (amplitude > 0)
        relative = typical / np.where(valid, amplitude, typical).astype(np.float32)
    return values[None], valid, relative


def _weighted(
    channels: Channels, some: Statistics | None, distance: Image, amplitude: Image | None
) -> Samples:
    """Samples with σ ∝ `relative`, scaled to a typical weight of one: the unit of the values drops out."""
    values, valid, relative = channels(distance, amplitude)
    if some is None:
        return Samples(np.zeros_like(values), np.zeros_like(relative), 0, bent=True)
    variance = some.noise * relative * relative + np.float32((FLOOR * some.spread) ** 2 + 1e-30)
    typical = some.noise * some.relative**2 + (FLOOR * some.spread) ** 2 + 1e-30
    weights = np.where(valid, np.float32(typical) / variance, 0)
    scaled = (values - some.middle[:, None, None, None]) * some.factor(some.relative)
    return Samples(scaled, weights, 0, bent=True)
