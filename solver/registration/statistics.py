"""Noise and range of samples, from a few thousand of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

PLENTY = 5000  # values for medians, which then are within two hundredths
FLOOR = 0.004  # of the scene's range: the mosaic itself is no better than that beside edges


def some_of(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Frames and rows of (N, H, W) that are looked at."""
    count, height, width = shape
    return slice(None, None, max(1, 8 * count * width // PLENTY)), slice(None, None, max(1, height // 8))


@dataclass(frozen=True, slots=True)
class Statistics:
    """Of about eight rows of some frames: noise c² in σ = c · relative, range, medians."""

    noise: float
    spread: float
    middle: NDArray[np.float32]
    relative: float

    def factor(self, relative: float) -> np.float32:
        """1 / deviation of samples of that relative noise; 0 where all are alike, so that they stay so."""
        variance = self.noise * relative**2 + (FLOOR * self.spread) ** 2
        return np.float32(1 / np.sqrt(variance) if variance > 0 else 0)

    @classmethod
    def of(cls, values: Image, valid: Mask, relative: Image) -> "Statistics | None":
        part = some_of(valid.shape)
        kept, some, factor = values[:, *part], valid[part], relative[part]
        if not some.any():
            kept, some, factor = values, valid, relative
        if not some.any():
            return None
        used = kept[:, some]
        low, middle, high = np.percentile(used, (2, 50, 98), axis=1)
        spread = float(np.sqrt(((high - low) ** 2).sum()))
        return cls(
            _noise(kept, some, factor), spread, middle.astype(np.float32), float(np.median(factor[some]))
        )


def _noise(values: Image, valid: Mask, relative: Image) -> float:
    """c² from second differences along rows: they vanish on slopes, and their median ignores edges."""
    usable = valid[..., :-2] & valid[..., 1:-1] & valid[..., 2:]
    if values.shape[-1] < 3 or not usable.any():
        return 0.0
    bend = values[..., :-2] - 2 * values[..., 1:-1] + values[..., 2:]
    r2 = relative * relative
    size = np.sqrt(r2[..., :-2] + 4 * r2[..., 1:-1] + r2[..., 2:])
    ratio = np.abs(bend[:, usable]) / size[usable]
    return float(np.median(ratio) / 0.6745) ** 2  # the median of |normal| is 0.6745 σ
