"""The samples that registration looks at, one after another: what is left out costs nothing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.kernels.nodes import gather
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
        gather(samples.values, samples.weights, base, keep, shift, *arrays, first)
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
