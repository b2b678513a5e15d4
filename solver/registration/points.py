"""The samples that registration looks at, one after another: what is left out costs nothing."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from solver.registration.samples import Samples

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

WHOLE = 30  # a shift that brings every pixel of an image to 0


@dataclass(frozen=True, slots=True)
class Points:
    """Used samples of all frames, frame by frame.

    Attributes:
        values: (P, C).
        weights: (P,) 1/σ².
        row, column: (P,) what the motion places: pixels, or rays.
        pixel: (P,) number of the pixel in its image.
        first: (N + 1,) where each frame begins, and the end.
        shape: rows and columns of the images.
        level: how often they were pooled by two.
        bent: whether they are, as in `Samples`.
    """

    values: Image
    weights: Image
    row: Image
    column: Image
    pixel: NDArray[np.int32]
    first: NDArray[np.int64]
    shape: tuple[int, int]
    level: int
    bent: bool

    @classmethod
    def of(cls, samples: Samples, base: Image, active: Mask) -> "Points":
        """All used samples of the active frames; `base` (2, H, W) is what the motion places."""
        return cls._gathered(samples, base, active[:, None, None], WHOLE)

    @classmethod
    def within(cls, samples: Samples, base: Image, blocks: Mask) -> "Points":
        """The used samples in those 2 × 2 `blocks` (N, H // 2, W // 2) that are set."""
        return cls._gathered(samples, base, blocks, 1)

    @classmethod
    def _gathered(cls, samples: Samples, base: Image, keep: Mask, shift: int) -> "Points":
        most = samples.weights.size
        values = np.empty((most, len(samples.values)), np.float32)
        weights, row, column = (np.empty(most, np.float32) for _ in range(3))
        pixel = np.empty(most, np.int32)
        first = np.zeros(len(samples.weights) + 1, np.int64)
        arrays = (values, weights, row, column, pixel)
        _gather(samples.values, samples.weights, base, keep, shift, *arrays, first)
        end = first[-1]
        return cls(
            values[:end],
            weights[:end],
            row[:end],
            column[:end],
            pixel[:end],
            first,
            samples.shape,
            samples.level,
            samples.bent,
        )

    def frame(self, number: int) -> "Points":
        """The samples of one frame."""
        part = slice(self.first[number], self.first[number + 1])
        return Points(
            self.values[part],
            self.weights[part],
            self.row[part],
            self.column[part],
            self.pixel[part],
            self.first[number : number + 2] - self.first[number],
            self.shape,
            self.level,
            self.bent,
        )


@numba.njit(cache=True)
def _gather(values, weights, base, keep, shift, y, w, row, column, pixel, first):  # type: ignore[no-untyped-def]
    channels, count, height, width = values.shape
    last_row, last_column = keep.shape[1] - 1, keep.shape[2] - 1  # an odd last pixel has no block of its own
    s = 0
    for k in range(count):
        for i in range(height):
            used, kept = weights[k, i], keep[k, min(i >> shift, last_row)]
            for j in range(width):
                if used[j] > 0.0 and kept[min(j >> shift, last_column)]:
                    w[s] = used[j]
                    row[s] = base[0, i, j]
                    column[s] = base[1, i, j]
                    pixel[s] = i * width + j
                    for h in range(channels):
                        y[s, h] = values[h, k, i, j]
                    s += 1
        first[k + 1] = s
