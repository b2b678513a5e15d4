"""The frames as samples with weights, at full and at pooled resolution."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

SMALLEST = 20  # pixels of the shorter side under which pooling leaves nothing to align


@dataclass(frozen=True, slots=True)
class Samples:
    """Values (N, H, W), weights 1/σ² (0 = not used), and how often they were pooled by two."""

    values: Image
    weights: Image
    level: int

    def pooled(self) -> "Samples":
        """Weighted 2 × 2 means; an odd last row or column is left out."""
        count, height, width = self.values.shape
        blocks = (count, height // 2, 2, width // 2, 2)
        values = self.values[:, : height // 2 * 2, : width // 2 * 2].reshape(blocks)
        weights = self.weights[:, : height // 2 * 2, : width // 2 * 2].reshape(blocks)
        total = weights.sum(axis=(2, 4))
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (values * weights).sum(axis=(2, 4)) / total
        # A block that is mostly missing would be a sample at another place.
        total[(weights > 0).sum(axis=(2, 4)) < 3] = 0
        return Samples(np.where(total > 0, mean, 0).astype(np.float32), total, self.level + 1)


def pyramid(samples: Samples) -> list[Samples]:
    """Full resolution first, then pooled while the shorter side allows, at most twice."""
    levels = [samples]
    while len(levels) < 3 and min(levels[-1].values.shape[1:]) >= 2 * SMALLEST:
        levels.append(levels[-1].pooled())
    return levels


def distance_samples(distance: Image, amplitude: Image | None) -> Samples:
    """Distances weighted by the noise law σ = c / amplitude, with c estimated from second differences.

    Second differences along rows vanish on slopes, and their median ignores edges. σ has a floor of 0.4 % of
    the scene's range, since the mosaic itself is no better than that beside edges.
    """
    valid = np.isfinite(distance)
    values = np.where(valid, distance, 0).astype(np.float32)
    relative = np.ones_like(values)
    if amplitude is not None:
        seen = valid & np.isfinite(amplitude) & (amplitude > 0)
        typical = float(np.median(amplitude[seen])) if seen.any() else 1.0
        relative = np.where(seen, typical / np.where(seen, amplitude, 1), np.inf).astype(np.float32)
        valid = seen
    variance = _noise_variance(values, valid, relative) * relative * relative
    floor = 0.004 * _spread(values[valid])
    weights = np.where(valid, 1 / (variance + floor * floor + np.float32(1e-30)), 0)
    # Scaled to a median of one: distances come in any unit, and float32 sums should not care.
    centre = float(np.median(weights[valid])) if valid.any() else 1.0
    scale = np.float32(np.sqrt(centre))
    offset = np.float32(np.median(values[valid])) if valid.any() else np.float32(0)
    return Samples((values - offset) * scale, (weights / np.float32(centre)).astype(np.float32), 0)


def _noise_variance(values: Image, valid: NDArray[np.bool_], relative: Image) -> float:
    if values.shape[2] < 3:
        return 0.0
    bend = values[:, :, :-2] - 2 * values[:, :, 1:-1] + values[:, :, 2:]
    r2 = relative * relative
    with np.errstate(invalid="ignore"):
        size = np.sqrt(r2[:, :, :-2] + 4 * r2[:, :, 1:-1] + r2[:, :, 2:])
    usable = valid[:, :, :-2] & valid[:, :, 1:-1] & valid[:, :, 2:]
    if not usable.any():
        return 0.0
    return (
        float(np.median(np.abs(bend[usable]) / size[usable]) / 0.6745) ** 2
    )  # median of |normal| is 0.6745 σ


def _spread(values: Image) -> float:
    if not values.size:
        return 0.0
    low, high = np.percentile(values, (2, 98))
    return float(high - low)
