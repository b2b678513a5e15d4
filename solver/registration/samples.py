"""The frames as samples with weights, at full and at pooled resolution."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError

Image = NDArray[np.float32]
Source = Literal["auto", "distance", "amplitude", "both"]

SMALLEST = 20  # pixels of the shorter side under which pooling leaves nothing to align
FLOOR = 0.004  # of the scene's range: the mosaic itself is no better than that beside edges


@dataclass(frozen=True, slots=True)
class Samples:
    """Values (C, N, H, W), weights 1/σ² (N, H, W; 0 = not used), and how often they were pooled by two."""

    values: Image
    weights: Image
    level: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.weights.shape[1], self.weights.shape[2]

    def pooled(self) -> "Samples":
        """Weighted 2 × 2 means; an odd last row or column is left out."""
        channels, count, height, width = self.values.shape
        rows, columns = height // 2, width // 2
        values = self.values[..., : rows * 2, : columns * 2].reshape(channels, count, rows, 2, columns, 2)
        weights = self.weights[:, : rows * 2, : columns * 2].reshape(count, rows, 2, columns, 2)
        total = weights.sum(axis=(2, 4))
        mean = (values * weights).sum(axis=(3, 5)) / np.where(total > 0, total, 1)
        # A block that is mostly missing would be a sample at another place.
        total[(weights > 0).sum(axis=(2, 4)) < 3] = 0
        return Samples(mean, total, self.level + 1)


def pyramid(samples: Samples) -> list[Samples]:
    """Full resolution first, then pooled while the shorter side allows, at most twice."""
    levels = [samples]
    while len(levels) < 3 and min(levels[-1].shape) >= 2 * SMALLEST:
        levels.append(levels[-1].pooled())
    return levels


def make_samples(
    distance: Image, amplitude: Image | None, ambiguity_range: float | None, source: Source
) -> Samples:
    """Channels that average linearly over a pixel's footprint, and their weights.

    - `distance`: the distance, weighted by the noise law σ = c / amplitude where amplitude is given.
    - `amplitude`: the amplitude.
    - `both`: the phasor amplitude · exp(2πi · distance / ambiguity range), as real and imaginary part;
      without an ambiguity range its first-order form, amplitude and amplitude · (distance − typical one).
      Noise is uniform there, and an edge is a ramp one pixel wide, whichever side is brighter.
    - `auto`: `both` where amplitude is given.

    Raises:
        FusionInputError: a source that needs amplitude, without amplitude.
    """
    valid = np.isfinite(distance)
    if source == "distance" or (source == "auto" and amplitude is None):
        return _distance_samples(distance, amplitude, valid)
    if amplitude is None:
        raise FusionInputError(f"registration from {source!r} needs amplitude; give it, or use 'distance'")
    valid &= np.isfinite(amplitude)
    light = np.where(valid, amplitude, 0)
    if source == "amplitude":
        return _weighted(light[None], valid, np.ones_like(light))
    if ambiguity_range is not None:
        angle = np.where(valid, distance, 0) * np.float32(2 * np.pi / ambiguity_range)
        return _weighted(np.stack([light * np.cos(angle), light * np.sin(angle)]), valid, np.ones_like(light))
    middle = float(np.median(distance[valid])) if valid.any() else 0.0
    return _both_without_range(light, np.where(valid, distance - middle, 0), valid)


def _both_without_range(light: Image, offset: Image, valid: NDArray[np.bool_]) -> Samples:
    moment = light * offset
    even = np.ones_like(light)
    # The moment is scaled to the amplitude's noise, or to its range where there is no noise.
    noise = [
        np.sqrt(_noise_variance(image[None], valid, even)) + FLOOR * _spread(image[None], valid)
        for image in (light, moment)
    ]
    moment *= np.float32(noise[0] / noise[1]) if noise[1] > 0 else np.float32(0)
    return _weighted(np.stack([light, moment]), valid, even)


def _distance_samples(distance: Image, amplitude: Image | None, valid: NDArray[np.bool_]) -> Samples:
    values = np.where(valid, distance, 0).astype(np.float32)
    relative = np.ones_like(values)
    if amplitude is not None:
        valid = valid & np.isfinite(amplitude) & (amplitude > 0)
        typical = float(np.median(amplitude[valid])) if valid.any() else 1.0
        relative = typical / np.where(valid, amplitude, typical).astype(np.float32)
    return _weighted(values[None], valid, relative)


def _weighted(values: Image, valid: NDArray[np.bool_], relative: Image) -> Samples:
    """Samples with σ ∝ `relative`, scaled to a typical weight of one: the unit of the values drops out."""
    if not valid.any():
        return Samples(np.zeros_like(values), np.zeros_like(relative), 0)
    variance = _noise_variance(values, valid, relative) * relative * relative
    floor = FLOOR * _spread(values, valid)
    weights = np.where(valid, 1 / (variance + np.float32(floor * floor + 1e-30)), 0)
    typical = float(np.median(weights[valid]))
    offset = np.median(values[:, valid], axis=1)[:, None, None, None]
    scaled = (values - offset) * np.float32(np.sqrt(typical))
    return Samples(scaled.astype(np.float32), (weights / np.float32(typical)).astype(np.float32), 0)


def _noise_variance(values: Image, valid: NDArray[np.bool_], relative: Image) -> float:
    """c² in σ = c · relative, from second differences along rows.

    They vanish on slopes, and their median ignores edges.
    """
    if values.shape[-1] < 3:
        return 0.0
    usable = valid[..., :-2] & valid[..., 1:-1] & valid[..., 2:]
    if not usable.any():
        return 0.0
    bend = values[..., :-2] - 2 * values[..., 1:-1] + values[..., 2:]
    r2 = relative * relative
    size = np.sqrt(r2[..., :-2] + 4 * r2[..., 1:-1] + r2[..., 2:])
    ratio = np.abs(bend[:, usable]) / size[usable]
    return float(np.median(ratio) / 0.6745) ** 2  # the median of |normal| is 0.6745 σ


def _spread(values: Image, valid: NDArray[np.bool_]) -> float:
    low, high = np.percentile(values[:, valid], (2, 98), axis=1)
    return float(np.sqrt(((high - low) ** 2).sum()))
