"""Which samples the other frames contradict: somebody walks by, stray light hits a pixel, the phase wraps.

All frames see one scene, so a sample lies within what the frames say of the nearest nine pixels: the least
and the greatest of their medians over the frames. One that lies far outside is left out. Deconvolution would
otherwise fit it by swings many times as large.

    |y − (low + high) / 2| > (high − low) + 5 σ

Medians hold for as long as fewer than half of the frames disagree (Huber, "Robust Statistics", 1981).
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import consensus as kernels
from solver.kernels import team

Image = NDArray[np.float32]

MAJORITY = 3
"""Frames on a pixel of which two can outvote one."""

_SLACK = (1.0, 5.0, 1e-6)
"""Allowed: high − low from the middle, deviations, and rounding. Two depth maps at three noise levels and two
recordings have 1 to 14 samples in a burst beyond it, most of them on the dark print, at any number of frames
from 3 up; half as much beyond the bounds finds 31 true ones on the finest structures."""

_GAP = 5
"""Pixels across which samples left out are joined: at an edge behind somebody, too much is allowed."""

_SWING = (1.5, 3.0)
"""What a map may swing to beside edges: high − low from the middle, and deviations. Without wrong samples one
fused pixel in a thousand lies beyond it, and no error grows by more than 2 %."""

_FEW = 500
"""One of so many samples of a frame may be judged anew without the frame being exchanged for it."""


@dataclass(slots=True)
class Consensus:
    """What frames say together, and which of their samples agree.

    Attributes:
        measured: (N, H, W) float32, NaN = invalid.
        sigma: (N, H, W), one standard deviation of each.
        positions: (N, H, W, 2), where they look on the grid.
        span: the ambiguity range, where whole ones do not matter; 0 = they do.
        agrees: (N, H, W).
    """

    measured: Image
    sigma: Image
    positions: Image
    span: float = 0.0
    agrees: NDArray[np.bool_] = field(init=False)
    _planes: Image = field(init=False)
    _low: Image = field(init=False)
    _high: Image = field(init=False)

    def __post_init__(self) -> None:
        shape = self.measured.shape
        self._planes, self.agrees = np.empty(shape, np.float32), np.empty(shape, np.bool_)
        self._low, self._high = np.empty(shape[1:], np.float32), np.empty(shape[1:], np.float32)

    def judge(self, frames: slice = slice(None)) -> None:
        """Judge all samples, after those of some frames have changed."""
        team.share(kernels.align, self.measured[frames], self.positions[frames], self._planes[frames])
        team.share(kernels.medians, self._planes, MAJORITY, self._low, self._high)
        around = np.ones((3, 3), np.uint8)
        cv2.erode(self._low, around, dst=self._low)
        cv2.dilate(self._high, around, dst=self._high)
        against = np.empty(self.measured.shape[:2], np.int32)
        samples = self.measured, self.sigma, self.positions
        slack = tuple(np.float32(part) for part in _SLACK)
        bounds, span = (self._low, self._high), np.float32(self.span)
        team.share(kernels.judge, *samples, bounds, slack, span, self.agrees, against)
        for number in np.flatnonzero(against.any(axis=1)):
            self._close(int(number))

    def _close(self, number: int) -> None:
        """Samples among those that do not agree with the scene belong to the same thing before it."""
        apart = np.logical_not(self.agrees[number]).view(np.uint8)
        closed = cv2.morphologyEx(apart, cv2.MORPH_CLOSE, np.ones((_GAP, _GAP), np.uint8))
        np.equal(closed, 0, out=self.agrees[number])

    def changed(self, distance: Image) -> list[int]:
        """The frames of which the verdict on more than a few samples is new.

        Args:
            distance: (N, H, W), `measured` or NaN where a sample is not used until now.
        """
        changes = np.empty(distance.shape[:2], np.int32)
        team.share(kernels.changes, self.measured, distance, self.agrees, changes)
        few = distance[0].size // _FEW
        return [int(number) for number in np.flatnonzero(changes.sum(axis=1) > few)]

    def kept(self, frames: slice | int = slice(None)) -> Image:
        """The samples that agree, NaN in the place of the others."""
        return np.where(self.agrees[frames], self.measured[frames], np.float32(np.nan))

    def contradicted(self) -> float:
        """The part of the valid samples that the others contradict."""
        known = np.isfinite(self.measured)
        return float((known & ~self.agrees).sum() / max(1, known.sum()))

    def limit(self, distance: Image, deviation: float) -> None:
        """Bring a map (βH, βW) that swings far beyond what the frames say back to where that begins.

        Args:
            deviation: of the usual sample.
        """
        with np.errstate(invalid="ignore"):  # −∞ + ∞: no bounds
            middle, reach = 0.5 * (self._low + self._high), _SWING[0] * (self._high - self._low)
        reach += np.float32(_SWING[1] * deviation)
        factor = distance.shape[0] // self._low.shape[0]
        team.share(kernels.limit, distance, middle - reach, middle + reach, factor)
